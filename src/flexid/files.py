"""Files: from outside bounded in size and refused in one sentence; written whole or not at all."""

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

Refuse = Callable[[str], Exception]  # makes an error of a reason

_ADDRESS = re.compile(r"^([a-z]{2,}):/(?=[^/])")


def shown(path: Path) -> str:
    """The path as it was given, for a message: on one line, and no longer than one can read."""
    text = "".join(
        character if character.isprintable() else repr(character)[1:-1] for character in str(path)
    )
    text = _ADDRESS.sub(r"\1://", text)  # an address has two slashes, of which a path keeps one
    return text if len(text) <= 300 else f"{text[:140]}...{text[-140:]}"


def check_file(path: Path, wanted: str, refuse: Refuse) -> int:
    """Size in bytes of an ordinary file."""
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
        raise refuse(_not_opened(error, remedy)) from None
    if stat.S_ISDIR(status.st_mode):
        raise refuse(f"this is a folder: {remedy}")
    if not stat.S_ISREG(status.st_mode):  # opening a pipe would wait for its other end
        raise refuse("this is not a regular file: copy its content into one")
    return status.st_size


def read_bytes(path: Path, limit: int, wanted: str, refuse: Refuse, *, shorten: str = "") -> bytes:
    """Bytes of a file of at most `limit` bytes."""
    size = check_file(path, wanted, refuse)
    if size <= limit:
        try:
            with path.open("rb") as file:  # as many bytes as are asked for are reserved
                raw = file.read(size + 1)
        except OSError as error:
            raise refuse(_not_opened(error, f"give the path of {wanted}")) from None
        if len(raw) <= size:
            return raw
        raise refuse("the file grows while it is read: wait until it is complete")
    most = f"{limit / 1e6:g} MB" if limit >= 1_000_000 else f"{limit / 1e3:g} kB"
    raise refuse(
        f"the file is larger than {most}, the most that is read: {shorten or f'give {wanted}'}"
    )


def sha256(path: Path) -> str:
    """Digest of a file's bytes, however long it is."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _not_opened(error: OSError | ValueError, remedy: str) -> str:
    reason = (getattr(error, "strerror", None) or str(error)).lower()
    return f"the file cannot be opened ({reason}): {remedy}"


def write_atomically(path: Path, write: Callable[[Path], object]) -> None:
    """Write a file under a temporary name, and rename it when it is on the disk."""
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
    # Windows wants a file that is open for writing
    handle = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def write_document(path: Path, text: str) -> None:
    """Write a text file that appears whole or not at all; a `SettingError` if it cannot."""
    try:
        write_atomically(path, lambda place: place.write_text(text, encoding="utf-8"))
    except (OSError, ValueError) as error:  # ValueError: a null character in the path
        raise _not_written("path", path, error) from None


def _not_written(setting: str, path: Path, error: OSError | ValueError) -> SettingError:
    reason = (getattr(error, "strerror", None) or "its name cannot be used").lower()
    return SettingError(setting, f"{path} cannot be written ({reason}): name another place")


def check_name(directory: Path, setting: str = "out") -> None:
    """Raise where a directory's name is not UTF-8: Polars can neither read nor write there."""
    try:
        str(directory).encode()
    except UnicodeEncodeError:
        raise SettingError(setting, "its name is not UTF-8: name another directory") from None


@contextmanager
def output_directory(out: Path) -> Iterator[Path]:
    """Directory to write into, whose files move to `out` only when all are written."""
    existed = out.exists()
    check_name(out)
    try:
        out.mkdir(parents=True, exist_ok=True)
        _sweep(out)
        staging = Path(tempfile.mkdtemp(prefix=f"{_staging()}{os.getpid()}-", dir=out))
    except OSError as error:
        raise _not_written("out", out, error) from None
    try:
        yield staging
        _move_all(staging, out)
    except BaseException:
        shutil.rmtree(staging if existed else out, ignore_errors=True)
        raise
    staging.rmdir()


def _staging() -> str:
    """How the names of folders begin that processes of this machine write into."""
    return f".flexid-{platform.node()}-"


def _sweep(out: Path) -> None:
    """Remove the folders that killed processes have left."""
    if os.name != "posix":  # elsewhere a process cannot be asked whether it lives
        return
    for left in out.iterdir():
        process = left.name.removeprefix(_staging()).partition("-")[0]
        if left.name.startswith(_staging()) and process.isdigit():
            try:
                os.kill(int(process), 0)
            except ProcessLookupError:
                shutil.rmtree(left, ignore_errors=True)
            except OSError:
                pass  # another user's


def _move_all(staging: Path, out: Path) -> None:
    files = list(staging.iterdir())
    for file in files:
        if (out / file.name).is_dir():  # before the first move, so that none is left half done
            raise SettingError("out", f"{out / file.name} is a directory: move it away")
    for file in files:
        os.replace(file, out / file.name)


if TYPE_CHECKING:
    from pydantic import BaseModel, ValidationError

MAX_BYTES = 200_000  # largest file that is read

_MOST_PARTS = 20  # of a key, such as controller.nominal.k
_LONG_KEY = re.compile(
    rb"(?:\.[ \t]*+(?:[\w-]++|\"[^\"\n]{0,99}\"|'[^'\n]{0,99}')[ \t]*+){%d}" % _MOST_PARTS
)

RefuseKey = Callable[[str, str], Exception]
"""Makes an error of a key, empty where the whole file is meant, and a reason, a predicate."""

Content = TypeVar("Content", bound="BaseModel")


def read_small(path: Path, wanted: str, refuse: RefuseKey) -> bytes:
    """Read a small file."""
    return read_bytes(path, MAX_BYTES, wanted, partial(refuse, ""))


def is_arm_file(model: str) -> bool:
    """Whether it is the path of a TOML file, which is that of an arm."""
    return model.lower().endswith(".toml")


def refuse_arm_file(model: str) -> None:
    """Raise a `SettingError` for an arm where the model of one joint is wanted."""
    if is_arm_file(model):
        raise SettingError(
            "model", f"{model!r} is an arm: only flexid identify, the command, takes it"
        )


def parse_toml(raw: bytes, refuse: RefuseKey) -> dict[str, Any]:
    """Tables of a TOML file, from its bytes."""
    if _LONG_KEY.search(raw):  # tomllib takes minutes and gigabytes for it
        raise refuse("", f"has a key of more than {_MOST_PARTS} parts: correct it")
    try:
        return tomllib.loads(raw.decode("utf-8-sig"))
    except UnicodeDecodeError as error:
        raise refuse("", f"is not text at byte {error.start}: save it as UTF-8") from None
    except tomllib.TOMLDecodeError as error:
        if raw.lstrip().startswith(b"{"):
            raise refuse("", "is JSON, as an estimate: give a file in TOML") from None
        raise refuse("", f"is not TOML: {one_line(str(error))}; correct it") from None
    except (RecursionError, ValueError):
        raise refuse("", "is not TOML that can be read: simplify it") from None


def validated(content: object, schema: type[Content], refuse: RefuseKey) -> Content:
    """The content as an instance of the schema, checked for keys, types and ranges."""
    from pydantic import ValidationError

    try:
        return schema.model_validate(content)
    except ValidationError as error:
        raise refuse(*first_complaint(error, content)) from None


def first_complaint(error: ValidationError, content: object) -> tuple[str, str]:
    """The key of the content that is wrong first, and the reason, a predicate."""
    # A misspelt key is missing too; its own spelling says more.
    first = min(error.errors(include_url=False), key=lambda one: one["type"] != "extra_forbidden")
    key = _key(first["loc"], content, first["type"] == "missing")
    if first["type"] == "missing":
        return key, "is missing: add it"
    if first["type"] == "extra_forbidden":
        return key, "is unknown: remove it or correct its spelling"
    tables = ("model_type", "model_attributes_type", "dict_type", "mapping_type", "dataclass_type")
    if first["type"] in tables:
        return key, "must be a table: correct it"
    if first["type"].startswith("union_tag"):  # the key that says what kind of table it is
        context = {name: str(text).replace("'", "") for name, text in first.get("ctx", {}).items()}
        key = f"{key}.{context['discriminator']}"
        if "expected_tags" in context:
            return key, f"must be one of {context['expected_tags']}: correct it"
        return key, "is missing or not text: correct it"
    message = one_line(first["msg"]).removeprefix("Value error, ")
    return key, f"is wrong, {message[:1].lower()}{message[1:]}: correct it"


def _key(location: tuple[int | str, ...], content: Any, missing: bool) -> str:
    """Dotted key of a place in the content, without the names that a schema gives to kinds."""
    parts, inside = [], content
    for place, part in enumerate(location, start=1):
        items: Any = dict(enumerate(inside)) if isinstance(inside, list) else inside
        there = isinstance(items, dict) and part in items
        if there or (missing and place == len(location)):
            parts.append(str(part + 1) if isinstance(part, int) else part)
            inside = items[part] if there else None
    return one_line(".".join(parts))[:80]


def one_line(text: str) -> str:
    """The text without line breaks."""
    return " ".join(text.split())
