"""Generated modules on disk: built once, found again by a hash of what is in them.

A kernel is ONE self-contained Python file of generated functions followed by templates. numba's
disk cache does not notice a change in a function called from another file, so nothing is imported
from elsewhere and the file's name is a hash of its text.

What is generated for the usual drive is part of the package. Other generated parts lie beside the
kernel, in the folder ``derived``, under a hash of the declarations and of
the code that generates. A change of that code costs another derivation, of some seconds; what comes
out of it as it was, is not compiled again.
"""

import atexit
import hashlib
import importlib.util
import logging
import os
import re
import shutil
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from functools import cache
from importlib import resources
from pathlib import Path
from types import ModuleType
from typing import Any

import platformdirs

from flexid.files import write_atomically

_LOG = logging.getLogger(__name__)

_LOADING = threading.RLock()  # a second thread would find half a module

_LOADED: dict[tuple[str, ...], ModuleType] = {}

CACHE_VARIABLE = "FLEXID_CACHE_DIR"
"""Environment variable that moves the cache of kernels."""

KEPT_DAYS = 30
"""A kernel that was not used for so long is removed when another one is made."""

_DAY = 86400.0


def load_kernel(
    task: str,
    declarations: Sequence[str],
    build: Callable[[], str] | None,
    templates: Sequence[str] = (),
) -> ModuleType:
    """Import a kernel with compiled functions, building its source first if it is not on disk yet.

    The declarations are digests of what it is generated from. Symbolic algebra costs nothing in
    later processes: `build` is called only when its text is missing. The templates follow that in
    order, each after those that it imports. Any number of processes may load and compile the same
    kernel at once.
    """
    directory = cache_directory()
    asked = (str(directory), _generator_digest(), task, *declarations, "", *templates)
    with _LOADING:
        kernel = _LOADED.get(asked)
        if kernel is None or sys.modules.get(kernel.__name__) is not kernel:
            kernel = _LOADED[asked] = _load(directory, task, declarations, build, templates)
        return kernel


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
        try:
            text = _provided(directory / "derived" / derived, build)
        except OSError:  # a full disk
            text = build()
    # How functions are compiled has to be known where the first of them stands.
    needed = sorted(with_needed(templates), key=lambda template: template != "compiled")
    texts = [*map(template, needed)]
    texts.insert(needed[:1] == ["compiled"], text or "")
    source = "\n\n".join(texts)
    name = f"flexid_{task}_{_digest(source)}"
    if name in sys.modules:
        return sys.modules[name]
    path = directory / f"{name}.py"
    try:
        _provided(path, lambda: source)
        return _import(name, path, source)
    except OSError:
        return _in_memory(name, source)


def shipped_name(task: str, declarations: Sequence[str]) -> str:
    """Name of the file in which the package has the generated part of a kernel, if it has it."""
    return f"{task}_{_digest(*declarations)}.txt"


def _shipped(task: str, declarations: Sequence[str]) -> str | None:
    """The generated part of a kernel of the usual drive: derived before, held by a test."""
    folder = resources.files("flexid.kernels").joinpath("derived")
    file = folder.joinpath(shipped_name(task, declarations))
    return file.read_text("utf-8") if file.is_file() else None


def _provided(path: Path, make: Callable[[], str]) -> str:
    """A source on disk: written if it is not there, whole, and marked as in use."""
    made = False
    if not path.exists():
        path.parent.mkdir(exist_ok=True)
        with _one_writer(path):
            if not path.exists():  # nobody else has made it in the meantime
                text = make()
                write_atomically(path, lambda file: file.write_text(text, "utf-8"))
                made = True
    _discard_damaged(path)
    mark = path.with_suffix(".used")
    if not mark.exists() or time.time() - mark.stat().st_mtime > _DAY:
        mark.touch()
    if made:
        _evict(path.parent)
    return path.read_text("utf-8")


def _compiled(path: Path, endings: tuple[str, ...] = (".nbi", ".nbc")) -> list[Path]:
    """Return numba's files of a kernel, but not those that are still being written (``.tmp``)."""
    folder, beginning = path.parent / "__pycache__", f"{path.stem}."
    if not folder.exists():
        return []
    # A listing of names takes a tenth of the time of a glob, and may hold thousands.
    names = (name for name in os.listdir(folder) if name.startswith(beginning))
    return [folder / name for name in names if name.endswith(endings)]


def is_compiled(kernel: ModuleType) -> bool:
    """Whether some of a kernel's functions are compiled on disk."""
    return kernel.__file__ is not None and bool(_compiled(Path(kernel.__file__)))


def _discard_damaged(path: Path) -> None:
    """Remove numba's files of a kernel if a full disk or a power failure left one empty."""
    with suppress(FileNotFoundError):  # another process is removing them
        if all(file.stat().st_size for file in _compiled(path)):
            return
    with _one_writer(path):
        _discard_compiled(path)


def _discard_compiled(path: Path) -> None:
    """Remove a kernel's bytecode, and all numba's files: a new index gives old names away."""
    for file in _compiled(path, (".nbi", ".nbc", ".pyc")):
        file.unlink(missing_ok=True)


def _evict(directory: Path) -> None:
    """Remove the sources that nobody has used for long, with what was compiled of them."""
    oldest = time.time() - KEPT_DAYS * _DAY
    for mark in directory.glob("*.used"):
        with suppress(FileNotFoundError):  # another process removes the same
            if mark.stat().st_mtime < oldest:
                _discard_compiled(mark)
                mark.with_suffix(".py").unlink()
                mark.unlink()


def _in_memory(name: str, source: str) -> ModuleType:
    """A kernel for this process alone, where nothing can be written: compiled, but not kept."""
    module = ModuleType(name)
    for kept in ("cache=", '"cache": '):
        source = source.replace(f"{kept}True", f"{kept}False")
    exec(compile(source, f"<{name}>", "exec"), vars(module))
    sys.modules[name] = module
    return module


@contextmanager
def _one_writer(path: Path) -> Iterator[None]:
    """Let one thread of one process at a time write the files of a kernel."""
    with ExitStack() as held:
        with suppress(NotImplementedError, OSError):  # a file system without locks
            held.enter_context(_lock(path))
        yield


@cache
def _lock(path: Path) -> Any:
    """The lock of a kernel's files: one object, so that a thread may take it more than once."""
    from filelock import FileLock  # late: only who writes waits for the import

    return FileLock(path.with_suffix(".lock"))


class _OneCompiles:
    """Loads a function's compiled code, or lets one process at a time compile and save it.

    To save, numba reads the function's index, adds a signature and writes it back. Of two
    processes that do so at once one signature is lost, or gets the code of the other. An index may
    also name a type of another kernel, if both were at work in one process; where that kernel is
    not loaded, all is compiled again.
    """

    def __init__(self, cache: Any, path: Path) -> None:
        self._path = path
        self._load, self._save = cache.load_overload, cache.save_overload
        self._compiling = ExitStack()
        cache.load_overload, cache.save_overload = self.load, self.save

    def load(self, *arguments: object) -> Any:
        """The compiled code; None, after which it is compiled and saved, if there is none."""
        found = self._loaded(*arguments)
        if found is None:
            self._compiling.enter_context(_one_writer(self._path))
            found = self._loaded(*arguments)  # unless another process has just saved it
            if found is not None:
                self._compiling.close()
            else:
                _announce()
        return found

    def _loaded(self, *arguments: object) -> Any:
        try:
            return self._load(*arguments)
        except ImportError:
            with _one_writer(self._path), suppress(OSError):
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
    return resources.files("flexid.kernels.templates").joinpath(f"{name}.py").read_text("utf-8")


_NEEDED = re.compile(r"^    from flexid\.kernels\.templates\.(?!generated)(\w+) import", re.M)


def with_needed(templates: Sequence[str]) -> tuple[str, ...]:
    """Templates in order, each once and after those that it imports for a checker of types."""
    found: dict[str, None] = {}
    for name in templates:
        found |= dict.fromkeys((*with_needed(_NEEDED.findall(template(name))), name))
    return tuple(found)


def cache_directory() -> Path:
    """Directory of the kernels: ``$FLEXID_CACHE_DIR``, the user's cache, or a temporary one."""
    return _writable(os.environ.get(CACHE_VARIABLE) or _of_the_user())


@cache
def _of_the_user() -> str:
    return platformdirs.user_cache_dir("flexid")


@cache
def _writable(wanted: str) -> Path:
    """The directory that is wanted, or a temporary one if nothing can be written there."""
    directory = Path(wanted)
    try:
        directory.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=directory):
            return directory
    except OSError:  # a read-only home directory
        # New and private: whatever lies there is run, so nobody else may have put it there.
        private = tempfile.mkdtemp(prefix="flexid-")
        atexit.register(shutil.rmtree, private, ignore_errors=True)
        return Path(private)


def _digest(*parts: str) -> str:
    content = hashlib.sha256()
    for part in parts:
        content.update(part.encode() + b"\0")
    return content.hexdigest()[:16]


@cache
def _generator_digest() -> str:
    """Hash of the code that generates: a changed derivation derives again.

    The declarations' code counts too: it fixes what a text means and the order of the parameters.
    """
    content = hashlib.sha256()
    for package in ("flexid.models", "flexid.control", "flexid.derivation"):
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
            compiling.enter_context(_one_writer(path))
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
