"""Files: read with a limit on their size, written completely or not at all."""

from __future__ import annotations

import errno
import hashlib
import os
import platform
import re
import shutil
import stat
import tempfile
import tomllib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from flexid.errors import SettingError

Refuse = Callable[[str], Exception]  # makes an error from a reason

_ADDRESS = re.compile(r"^([a-z]{2,}):/(?=[^/])")


def shown(path: Path) -> str:
    """Return a path for a message: one line of at most 300 characters."""
    text = "".join(
        character if character.isprintable() else repr(character)[1:-1] for character in str(path)
    )
    text = _ADDRESS.sub(r"\1://", text)  # a Path drops one of the two slashes of an address
    return text if len(text) <= 300 else f"{text[:140]}...{text[-140:]}"


def check_file(path: Path, wanted: str, refuse: Refuse) -> int:
    """Return the size of a regular file in bytes; raise for anything else."""
    remedy = f"give the path of {wanted}"
    try:
        status = os.stat(path)
    except FileNotFoundError:
        if _ADDRESS.match(str(path)):
            raise refuse(f"this is an address: download it, and {remedy}") from None
        if path.is_symlink():
            raise refuse(f"this is a link to a file that is not there: {remedy}") from None
        raise refuse(f"there is no such file: check the spelling, or {remedy}") from None
    except (OSError, ValueError) as error:
        if isinstance(error, OSError) and error.errno == errno.ELOOP:
            raise refuse(f"this is a link that leads back to itself: {remedy}") from None
        raise refuse(_opening_failure(error, remedy)) from None
    if stat.S_ISDIR(status.st_mode):
        raise refuse(f"this is a folder: {remedy}")
    if not stat.S_ISREG(status.st_mode):  # opening a pipe would block
        raise refuse("this is not a regular file: copy its content into one")
    return status.st_size


def read_bytes(path: Path, limit: int, wanted: str, refuse: Refuse, *, shorten: str = "") -> bytes:
    """Return the content of a file; raise if it has more than `limit` bytes."""
    size = check_file(path, wanted, refuse)
    if size <= limit:
        try:
            with path.open("rb") as file:  # Python allocates as many bytes as `read` asks for
                raw = file.read(size + 1)
        except OSError as error:
            raise refuse(_opening_failure(error, f"give the path of {wanted}")) from None
        if len(raw) <= size:
            return raw
        raise refuse("the file grows while it is read: wait until it is complete")
    most = f"{limit / 1e6:g} MB" if limit >= 1_000_000 else f"{limit / 1e3:g} kB"
    raise refuse(
        f"the file is larger than {most}, the most that is read: {shorten or f'give {wanted}'}"
    )


def sha256(path: Path) -> str:
    """Return the SHA-256 digest of a file of any length."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _opening_failure(error: OSError | ValueError, remedy: str) -> str:
    reason = (getattr(error, "strerror", None) or str(error)).lower()
    return f"the file cannot be opened ({reason}): {remedy}"


def write_atomically(path: Path, write: Callable[[Path], object]) -> None:
    """Write a file under a temporary name, and rename it once it is on the disk."""
    path = Path(os.path.realpath(path))  # a link stays
    if path.exists() and not (path.is_file() or path.is_dir()):  # root would replace /dev/null
        raise OSError(errno.EINVAL, "not a regular file")
    temporary = path.with_name(f".{path.name}.tmp")
    try:
        write(temporary)
        _synchronise(temporary)
        os.replace(temporary, path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    if os.name == "posix":  # elsewhere a directory cannot be opened
        _synchronise(path.parent)


def _synchronise(path: Path) -> None:
    # Windows flushes only files that are open for writing.
    handle = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def write_document(path: Path, text: str) -> None:
    """Write a text file completely or not at all; raise a `SettingError` if that fails."""
    try:
        write_atomically(path, lambda place: place.write_text(text, encoding="utf-8"))
    except (OSError, ValueError) as error:  # ValueError: a null character in the path
        raise _writing_error("path", path, error) from None


def _writing_error(setting: str, path: Path, error: OSError | ValueError) -> SettingError:
    reason = (getattr(error, "strerror", None) or "its name cannot be used").lower()
    return SettingError(setting, f"{path} cannot be written ({reason}): name another place")


def check_name(directory: Path, setting: str = "out") -> None:
    """Raise if a directory's name is not UTF-8: Polars can neither read nor write there."""
    try:
        str(directory).encode()
    except UnicodeEncodeError:
        raise SettingError(setting, "its name is not UTF-8: name another directory") from None


@contextmanager
def output_directory(out: Path) -> Iterator[Path]:
    """Yield a temporary directory; move its files to `out` when all are written."""
    existed = out.exists()
    check_name(out)
    try:
        out.mkdir(parents=True, exist_ok=True)
        _remove_abandoned(out)
        staging = Path(tempfile.mkdtemp(prefix=f"{_staging_prefix()}{os.getpid()}-", dir=out))
    except OSError as error:
        raise _writing_error("out", out, error) from None
    try:
        yield staging
        _move_all(staging, out)
    except BaseException:
        shutil.rmtree(staging if existed else out, ignore_errors=True)
        raise
    staging.rmdir()


def _staging_prefix() -> str:
    """Return the prefix of the temporary directories of this machine's processes."""
    return f".flexid-{platform.node()}-"


def _remove_abandoned(out: Path) -> None:
    """Remove the temporary directories that killed processes have left in `out`."""
    if os.name != "posix":  # elsewhere signal 0 does not test for a process
        return
    for left in out.iterdir():
        process = left.name.removeprefix(_staging_prefix()).partition("-")[0]
        if left.name.startswith(_staging_prefix()) and process.isdigit():
            try:
                os.kill(int(process), 0)
            except ProcessLookupError:
                shutil.rmtree(left, ignore_errors=True)
            except OSError:
                pass  # the process of another user


def _move_all(staging: Path, out: Path) -> None:
    files = list(staging.iterdir())
    for file in files:
        if (out / file.name).is_dir():  # checked before the first move: all files move, or none
            raise SettingError("out", f"{out / file.name} is a directory: move it away")
    for file in files:
        os.replace(file, out / file.name)


if TYPE_CHECKING:
    from pydantic import BaseModel, ValidationError

MAX_BYTES = 200_000  # largest configuration file that is read

_MOST_PARTS = 20  # of a key, such as controller.nominal.k
_LONG_KEY = re.compile(
    rb"(?:\.[ \t]*+(?:[\w-]++|\"[^\"\n]{0,99}\"|'[^'\n]{0,99}')[ \t]*+){%d}" % _MOST_PARTS
)

RefuseKey = Callable[[str, str], Exception]
"""Makes an error from a key (empty for the whole file) and a reason (a predicate of the key)."""

Content = TypeVar("Content", bound="BaseModel")


def read_small(path: Path, wanted: str, refuse: RefuseKey) -> bytes:
    """Return the content of a file of at most `MAX_BYTES` bytes."""
    return read_bytes(path, MAX_BYTES, wanted, partial(refuse, ""))


def is_arm_file(model: str) -> bool:
    """Whether `model` is the path of a TOML file, which describes an arm."""
    return model.lower().endswith(".toml")


def refuse_arm_file(model: str) -> None:
    """Raise a `SettingError` if `model` is an arm, where one joint is required."""
    if is_arm_file(model):
        raise SettingError(
            "model", f"{model!r} is an arm: only flexid identify, the command, takes it"
        )


def parse_toml(raw: bytes, refuse: RefuseKey) -> dict[str, Any]:
    """Return the tables of a TOML file from its bytes."""
    if _LONG_KEY.search(raw):  # tomllib needs minutes and gigabytes for such a key
        raise refuse("", f"has a key of more than {_MOST_PARTS} parts: correct it")
    try:
        return tomllib.loads(raw.decode("utf-8-sig"))
    except UnicodeDecodeError as error:
        raise refuse("", f"is not text at byte {error.start}: save it as UTF-8") from None
    except tomllib.TOMLDecodeError as error:
        if raw.lstrip().startswith(b"{"):
            raise refuse("", "is JSON, like a saved estimate: give a TOML file") from None
        raise refuse("", f"is not TOML: {one_line(str(error))}; correct it") from None
    except (RecursionError, ValueError):
        raise refuse("", "is not TOML that can be read: simplify it") from None


def validated(content: object, schema: type[Content], refuse: RefuseKey) -> Content:
    """Return the content as an instance of the schema; raise if keys, types or ranges are wrong."""
    from pydantic import ValidationError

    try:
        return schema.model_validate(content)
    except ValidationError as error:
        raise refuse(*first_complaint(error, content)) from None


def first_complaint(error: ValidationError, content: object) -> tuple[str, str]:
    """Return the first wrong key of the content, and the reason as a predicate."""
    # A misspelt key also counts as missing; naming the misspelt key helps more.
    first = min(error.errors(include_url=False), key=lambda one: one["type"] != "extra_forbidden")
    key = _key(first["loc"], content, first["type"] == "missing")
    if first["type"] == "missing":
        return key, "is missing: add it"
    if first["type"] == "extra_forbidden":
        return key, "is unknown: remove it or correct its spelling"
    tables = ("model_type", "model_attributes_type", "dict_type", "mapping_type", "dataclass_type")
    if first["type"] in tables:
        return key, "must be a table: correct it"
    if first["type"].startswith("union_tag"):  # the key that selects the kind of table
        context = {name: str(text).replace("'", "") for name, text in first.get("ctx", {}).items()}
        key = f"{key}.{context['discriminator']}"
        if "expected_tags" in context:
            return key, f"must be one of {context['expected_tags']}: correct it"
        return key, "is missing or not text: correct it"
    message = one_line(first["msg"]).removeprefix("Value error, ")
    return key, f"is wrong, {message[:1].lower()}{message[1:]}: correct it"


def _key(location: tuple[int | str, ...], content: Any, missing: bool) -> str:
    """Dotted key of a location, without the names by which a schema labels alternatives."""
    parts, inside = [], content
    for place, part in enumerate(location, start=1):
        items: Any = dict(enumerate(inside)) if isinstance(inside, list) else inside
        there = isinstance(items, dict) and part in items
        if there or (missing and place == len(location)):
            parts.append(str(part + 1) if isinstance(part, int) else part)
            inside = items[part] if there else None
    return one_line(".".join(parts))[:80]


def one_line(text: str) -> str:
    """Return the text without line breaks."""
    return " ".join(text.split())
