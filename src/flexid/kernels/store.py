"""Generated modules on disk: built once, found again by a hash of what is in them."""

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

_LOG = logging.getLogger(__name__)

_LOADING = threading.RLock()  # a second thread would find half a module

_LOADED: dict[tuple[str, ...], ModuleType] = {}

CACHE_VARIABLE = "FLEXID_CACHE_DIR"  # environment variable that moves the cache of kernels


# A kernel is ONE self-contained Python file: numba's disk cache does not notice a change in a
# function called from another file. Generated parts have a file of their own, so that a change of
# the generator costs another derivation but compiles again only what comes out differently.
def load_kernel(
    task: str,
    declarations: Sequence[str],
    build: Callable[[], str] | None,
    templates: Sequence[str] = (),
) -> ModuleType:
    """Import a kernel; `build` is called for a generated part that is not on disk yet."""
    asked = (_generator_digest(), task, *declarations, "", *templates)
    with _LOADING:
        if asked not in _LOADED:
            directory = cache_directory()
            try:
                _LOADED[asked] = _load(directory, task, declarations, build, templates)
            except (OSError, NotImplementedError) as error:  # of a file system without locks
                reason = getattr(error, "strerror", None) or error
                raise SettingError(
                    "cache",
                    f"{directory} cannot be written ({reason}): make room there, or set "
                    f"{CACHE_VARIABLE} to another folder",
                ) from None
        return _LOADED[asked]


def _load(
    directory: Path,
    task: str,
    declarations: Sequence[str],
    build: Callable[[], str] | None,
    templates: Sequence[str],
) -> ModuleType:
    """Import a kernel that this process has not loaded yet."""
    text = "" if build is None else _shipped(task, declarations)
    if text is None and build is not None:
        derived = f"{task}_{_digest(_generator_digest(), *declarations)}.py"
        text = _provided(directory / "derived" / derived, build)
    # How functions are compiled has to be known where the first of them stands.
    needed = sorted(with_needed(templates), key=lambda template: template != "compiled")
    texts = [*map(template, needed)]
    texts.insert(needed[:1] == ["compiled"], text or "")
    source = "\n\n".join(texts)
    name = f"flexid_{task}_{_digest(source)}"
    if name in sys.modules:
        return sys.modules[name]
    path = directory / f"{name}.py"
    _provided(path, lambda: source)
    if not os.access(directory, os.W_OK):  # numba loads nothing from where it could not save
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
    _discard_damaged(path)
    return _import(name, path, source)


def shipped_name(task: str, declarations: Sequence[str]) -> str:
    """Name of the file in which the package has the generated part of a kernel, if it has it."""
    return f"{task}_{_digest(*declarations)}.txt"


def _shipped(task: str, declarations: Sequence[str]) -> str | None:
    """The generated part of a kernel of the usual drive: derived before, held by a test."""
    folder = resources.files("flexid.kernels").joinpath("derived")
    file = folder.joinpath(shipped_name(task, declarations))
    return file.read_text("utf-8") if file.is_file() else None


def _provided(path: Path, make: Callable[[], str]) -> str:
    """A source on disk: written if it is not there, whole."""
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        with _lock(path):
            if not path.exists():  # nobody else has made it in the meantime
                text = make()
                write_atomically(path, lambda file: file.write_text(text, "utf-8"))
    return path.read_text("utf-8")


def _compiled(path: Path, endings: tuple[str, ...] = (".nbi", ".nbc")) -> list[Path]:
    """Return numba's files of a kernel, but not those that are still being written (``.tmp``)."""
    folder, beginning = path.parent / "__pycache__", f"{path.stem}."
    if not folder.exists():
        return []
    # A listing of names takes a tenth of the time of a glob, and may hold thousands.
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
    """Remove a kernel's bytecode, and all numba's files: a new index gives old names away."""
    for file in _compiled(path, (".nbi", ".nbc", ".pyc")):
        file.unlink(missing_ok=True)


@cache
def _lock(path: Path) -> Any:
    """The lock of a kernel's files: one object, so that a thread may take it more than once."""
    from filelock import FileLock  # late: only who writes waits for the import

    return FileLock(path.with_suffix(".lock"))


class _OneCompiles:
    """Loads a function's compiled code, or lets one process at a time compile and save it."""

    def __init__(self, cache: Any, path: Path) -> None:
        self._path = path
        self._load, self._save = cache.load_overload, cache.save_overload
        self._compiling = ExitStack()
        cache.load_overload, cache.save_overload = self.load, self.save

    def load(self, *arguments: object) -> Any:
        """The compiled code; None, after which it is compiled and saved, if there is none."""
        found = self._loaded(*arguments)
        if found is None:
            # numba reads the index, adds a signature, writes it back: two at once lose one.
            self._compiling.enter_context(_lock(self._path))
            found = self._loaded(*arguments)  # unless another process has just saved it
            if found is not None:
                self._compiling.close()
            else:
                _announce()
        return found

    def _loaded(self, *arguments: object) -> Any:
        try:
            return self._load(*arguments)
        # The index names a type of another kernel that this process has not loaded.
        except ImportError:
            with _lock(self._path):
                _discard_compiled(self._path)
            return None

    def save(self, *arguments: object) -> None:
        """Save what was compiled; on a full disk it serves this process all the same."""
        with self._compiling.pop_all(), suppress(OSError):
            self._save(*arguments)


@cache
def _announce() -> None:
    """Say once in a process that something is compiled."""
    _LOG.info(
        "Compiling the models' functions, once for this machine: some ten seconds. They are kept "
        "in %s.",
        cache_directory(),
    )


@cache
def template(name: str) -> str:
    """Source text of a template: code that calls generated functions by name."""
    folders = (resources.files(package).joinpath("templates") for package in _PACKAGES)
    files = (folder.joinpath(f"{name}.py") for folder in folders)
    return next(file for file in files if file.is_file()).read_text("utf-8")


_PACKAGES = ("flexid.kernels", "flexid.paper", "flexid.recording")  # that have templates
_NEEDED = re.compile(r"^    from flexid\.\w+\.templates\.(?!generated)(\w+) import", re.M)


def with_needed(templates: Sequence[str]) -> tuple[str, ...]:
    """Templates in order, each once and after those that it imports for a checker of types."""
    found: dict[str, None] = {}
    for name in templates:
        found |= dict.fromkeys((*with_needed(_NEEDED.findall(template(name))), name))
    return tuple(found)


def cache_directory() -> Path:
    """Directory of the kernels: ``$FLEXID_CACHE_DIR``, or the user's cache."""
    return Path(os.environ.get(CACHE_VARIABLE) or _of_the_user())


@cache
def _of_the_user() -> str:
    return platformdirs.user_cache_dir("flexid")


def _digest(*parts: str) -> str:
    content = hashlib.sha256()
    for part in parts:
        content.update(part.encode() + b"\0")
    return content.hexdigest()[:16]


@cache
def _generator_digest() -> str:
    """Hash of the code that generates, and of that which fixes what declarations mean."""
    content = hashlib.sha256()
    for package in ("flexid.models", "flexid.derivation", "flexid.paper"):
        files = [f for f in resources.files(package).iterdir() if f.name.endswith((".py", ".toml"))]
        for file in sorted(files, key=lambda file: file.name):
            content.update(file.read_bytes())
    return content.hexdigest()


def _import(name: str, path: Path, source: str) -> ModuleType:
    """Import a kernel; what it compiles by that, one process at a time compiles."""
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
    for value in vars(module).values():  # functions that are compiled when they are called
        own_cache: Any = getattr(value, "_cache", None)
        if hasattr(own_cache, "save_overload"):
            _OneCompiles(own_cache, path)
    return module
