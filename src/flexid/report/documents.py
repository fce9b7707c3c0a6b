"""How results present themselves, and files that appear whole or not at all."""

import os
import platform
import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexid.errors import SettingError
from flexid.files import write_atomically

if TYPE_CHECKING:
    from flexid.report.charts.description import Chart
    from flexid.report.page.page import Page
    from flexid.report.terminal import Part


def write_document(path: Path, text: str) -> None:
    """Write a file that appears whole or not at all."""
    temporary = None

    def write(place: Path) -> None:
        nonlocal temporary
        temporary = place
        place.write_text(text, encoding="utf-8")

    try:
        write_atomically(path, write)
    except (OSError, ValueError) as error:  # ValueError: a null character in the path
        if temporary is not None:
            temporary.unlink(missing_ok=True)
        reason = getattr(error, "strerror", None) or "its name cannot be used"
        raise SettingError("path", f"{path} cannot be written ({reason})") from None


@contextmanager
def output_directory(out: Path) -> Iterator[Path]:
    """Directory to write into, whose files move to `out` only when all are written."""
    existed = out.exists()
    try:
        str(out).encode()
    except UnicodeEncodeError:  # Polars cannot write there
        raise SettingError("--out", "its name is not UTF-8: name another directory") from None
    try:
        out.mkdir(parents=True, exist_ok=True)
        _sweep(out)
        staging = Path(tempfile.mkdtemp(prefix=f"{_staging()}{os.getpid()}-", dir=out))
    except OSError as error:
        raise SettingError("--out", f"{out} cannot be written ({error.strerror})") from None
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
            raise SettingError("--out", f"{out / file.name} is a directory: move it away")
    for file in files:
        os.replace(file, out / file.name)


@dataclass(frozen=True)
class Presenter:
    """What there is to show of a kind of result; each function takes the result first."""

    parts: "Callable[..., Iterable[Part]]"  # tables and sentences
    document: "Callable[..., Mapping[str, Any]]"  # everything but the time series, for JSON
    charts: "Callable[..., Sequence[Chart]]" = lambda *_: ()  # the most important one first
    page: "Callable[..., Page] | None" = None  # takes the charts, the command and its folder too
    evidence: "Callable[..., Iterable[Part]]" = lambda *_: ()  # what choices rest on
    write_data: "Callable[..., None]" = lambda *_: None  # into a folder; whether as CSV, too
