"""Cache of generated modules on disk: each is built once and found by a hash of its content."""

import errno
import hashlib
import importlib.util
import logging
import os
import re
import sys
import threading
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from functools import cache
from importlib import resources
from pathlib import Path
from types import ModuleType
from typing import Any

import platformdirs

from flexid.errors import SettingError
from flexid.files import write_atomically
from flexid.models.parametric_system import ParametricSystem

_LOG = logging.getLogger(__name__)

_LOADING = threading.RLock()  # otherwise a second thread could find an incomplete module

_LOADED: dict[tuple[str, ...], ModuleType] = {}

CACHE_VARIABLE = "FLEXID_CACHE_DIR"  # environment variable with the folder of the cache


# A kernel is ONE self-contained Python file, because numba's disk cache does not notice a change of
# a function in another file. Generated parts are also saved separately: after a change of the
# generator they are derived again, but only kernels with another source are compiled again.
def load_kernel(
    task: str,
    declarations: Sequence[str],
    build: Callable[[], str] | None,
    templates: Sequence[str] = (),
) -> ModuleType:
    """Import a kernel; `build` makes a generated part that is not on disk yet."""
    key = (_generator_digest(), task, *declarations, "", *templates)
    with _LOADING:
        if key not in _LOADED:
            try:
                _LOADED[key] = _load(task, declarations, build, templates)
            except (OSError, NotImplementedError) as error:  # the latter without file locks
                reason = getattr(error, "strerror", None) or error
                raise SettingError(
                    "cache",
                    f"{cache_directory()} cannot be written ({reason}): make room there, or set "
                    f"{CACHE_VARIABLE} to another folder",
                ) from None
        return _LOADED[key]


def _load(
    task: str,
    declarations: Sequence[str],
    build: Callable[[], str] | None,
    templates: Sequence[str],
) -> ModuleType:
    """Import a kernel that this process has not loaded yet."""
    directory, text = cache_directory(), ""
    if build is not None:
        derived = f"{task}_{_digest(_generator_digest(), *declarations)}.py"
        shipped = _shipped(task, declarations)
        text = shipped or _read_or_make(directory / "derived" / derived, build)
    # The template with the decorators must come before the first function.
    needed = sorted(with_needed(templates), key=lambda template: template != "compiled")
    texts = [*map(template, needed)]
    texts.insert(needed[:1] == ["compiled"], text)
    source = "\n\n".join(texts)
    name = f"flexid_{task}_{_digest(source)}"
    if name in sys.modules:
        return sys.modules[name]
    path = directory / f"{name}.py"
    _read_or_make(path, lambda: source)
    if not os.access(directory, os.W_OK):  # numba does not load from a folder that is read-only
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
    _discard_damaged(path)
    return _import(name, path, source)


def model_kernel(task: str, system: ParametricSystem) -> ModuleType:
    """Load functions of a model, by their key in `flexid.derivation.model_functions.SOURCES`."""

    def build() -> str:
        from flexid.derivation.model_functions import SOURCES

        return SOURCES[task](system)

    return load_kernel(task, [system.digest], build)


def shipped_name(task: str, declarations: Sequence[str]) -> str:
    """Return the name of a kernel's generated part as a file of the package."""
    return f"{task}_{_digest(*declarations)}.txt"


def _shipped(task: str, declarations: Sequence[str]) -> str | None:
    """Generated part of a kernel, if the package contains it; a test keeps it up to date."""
    folder = resources.files("flexid.kernels").joinpath("derived")
    file = folder.joinpath(shipped_name(task, declarations))
    return file.read_text("utf-8") if file.is_file() else None


def _read_or_make(path: Path, make: Callable[[], str]) -> str:
    """Read a source from disk, after making and writing it if it is missing."""
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        with _lock(path):
            if not path.exists():  # unless another process has just made it
                text = make()
                write_atomically(path, lambda file: file.write_text(text, "utf-8"))
    return path.read_text("utf-8")


def _compiled(path: Path, endings: tuple[str, ...] = (".nbi", ".nbc")) -> list[Path]:
    """Return numba's files of a kernel, without unfinished ones (``.tmp``)."""
    folder, beginning = path.parent / "__pycache__", f"{path.stem}."
    if not folder.exists():
        return []
    # Listing takes a tenth of the time of a glob, and there may be thousands of files.
    names = (name for name in os.listdir(folder) if name.startswith(beginning))
    return [folder / name for name in names if name.endswith(endings)]


def _discard_damaged(path: Path) -> None:
    """Remove numba's files of a kernel if a full disk or a power failure left one empty."""
    with suppress(FileNotFoundError):  # another process is removing them
        if all(file.stat().st_size for file in _compiled(path)):
            return
    with _lock(path):
        _discard_compiled(path)


def _discard_compiled(path: Path) -> None:
    """Remove a kernel's bytecode and all numba's files: a new index would reuse their names."""
    for file in _compiled(path, (".nbi", ".nbc", ".pyc")):
        file.unlink(missing_ok=True)


@cache
def _lock(path: Path) -> Any:
    """Lock of a kernel's files: one object, so that a thread can take it more than once."""
    from filelock import FileLock  # imported here, because only writing needs it

    return FileLock(path.with_suffix(".lock"))


def _lock_compilation(cache: Any, path: Path) -> None:
    """Let one process at a time compile and save a function of a kernel."""
    load_unlocked, save_unlocked = cache.load_overload, cache.save_overload
    compiling = ExitStack()

    def load_if_saved(*arguments: object) -> Any:
        try:
            return load_unlocked(*arguments)
        # The index names a type of another kernel that this process has not loaded.
        except ImportError:
            with _lock(path):
                _discard_compiled(path)
            return None

    def load(*arguments: object) -> Any:
        """Return the compiled code, or None; numba then compiles and saves it."""
        found = load_if_saved(*arguments)
        if found is None:
            # numba reads the index, adds a signature, writes it back: two processes would lose one.
            compiling.enter_context(_lock(path))
            found = load_if_saved(*arguments)  # unless another process has just saved it
            if found is not None:
                compiling.close()
            else:
                _announce()
        return found

    def save(*arguments: object) -> None:
        """Save compiled code; on a full disk only this process uses it."""
        with compiling.pop_all(), suppress(OSError):
            save_unlocked(*arguments)

    cache.load_overload, cache.save_overload = load, save


@cache
def _announce() -> None:
    """Log once per process that functions are compiled."""
    _LOG.info(
        "Compiling the models' functions, once for this machine: some ten seconds. They are kept "
        "in %s.",
        cache_directory(),
    )


@cache
def template(name: str) -> str:
    """Return the source of a template, which calls generated functions by name."""
    folders = (resources.files(package).joinpath("templates") for package in _PACKAGES)
    files = (folder.joinpath(f"{name}.py") for folder in folders)
    return next(file for file in files if file.is_file()).read_text("utf-8")


_PACKAGES = ("flexid.kernels", "flexid.paper", "flexid.recording")  # packages with templates
_NEEDED = re.compile(r"^    from flexid\.\w+\.templates\.(?!generated)(\w+) import", re.M)


def with_needed(templates: Sequence[str]) -> tuple[str, ...]:
    """Return templates in order, each once, after the templates that it imports for type checks."""
    found: dict[str, None] = {}
    for name in templates:
        found |= dict.fromkeys((*with_needed(_NEEDED.findall(template(name))), name))
    return tuple(found)


def cache_directory() -> Path:
    """Return the folder of the kernels: ``$FLEXID_CACHE_DIR``, or the user's cache."""
    return Path(os.environ.get(CACHE_VARIABLE) or platformdirs.user_cache_dir("flexid"))


def _digest(*parts: str) -> str:
    content = hashlib.sha256()
    for part in parts:
        content.update(part.encode() + b"\0")
    return content.hexdigest()[:16]


@cache
def _generator_digest() -> str:
    """Hash of the packages that declare models and generate source."""
    content = hashlib.sha256()
    for package in ("flexid.models", "flexid.derivation", "flexid.paper"):
        files = [f for f in resources.files(package).iterdir() if f.name.endswith((".py", ".toml"))]
        for file in sorted(files, key=lambda file: file.name):
            content.update(file.read_bytes())
    return content.hexdigest()


def _import(name: str, path: Path, source: str) -> ModuleType:
    """Import a kernel; if the import compiles functions, one process at a time does so."""
    specification = importlib.util.spec_from_file_location(name, path)
    assert specification is not None
    assert specification.loader is not None
    module = importlib.util.module_from_spec(specification)
    sys.modules[name] = module
    with ExitStack() as compiling:
        if "cfunc(" in source and not _compiled(path):
            compiling.enter_context(_lock(path))
            if not _compiled(path):
                _announce()
        try:
            specification.loader.exec_module(module)
        except BaseException:
            del sys.modules[name]
            raise
    for value in vars(module).values():  # functions that are compiled at their first call
        own_cache: Any = getattr(value, "_cache", None)
        if hasattr(own_cache, "save_overload"):
            _lock_compilation(own_cache, path)
    return module
