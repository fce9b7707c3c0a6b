"""The cache of generated kernels, and the sources shipped with the package."""

import ast
import os
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from filelock import FileLock

from flexid.derivation.model_functions import compiled_signals
from flexid.derivation.sensitivities import sensitivity_functions
from flexid.errors import SettingError
from flexid.identification.preparation.joint import flexible, rigid
from flexid.kernels import store
from flexid.models.flexible_joint import flexible_joint
from flexid.paper.closed_loop import compose_loop, lane_loop_source, stiff_loop_source
from flexid.paper.laws import pd_gravity
from flexid.paper.loop import LoopDeclaration, sinusoid
from flexid.paper.sampled_loop import sampled_loop_source

OBSERVE = """
import sys
import numpy as np
from flexid.paper.parametric_observer import parametric_observer
from flexid.models.flexible_joint import flexible_joint
observer = parametric_observer(flexible_joint(), {"link": 1.0, "motor": 1.0}, 1e-3)
samples = np.outer(np.arange(20.0), [1e-3, 1.0, 2e-3, 2.0, 3.0])
print(repr(observer.replay(observer.init(), samples).coefficients[-1, 0]), "sympy" in sys.modules)
"""


def run(code: str, cache: Path) -> subprocess.Popen[str]:
    """Start Python with some code and a cache folder."""
    environment = {**os.environ, store.CACHE_VARIABLE: str(cache)}
    return subprocess.Popen(
        [sys.executable, "-c", code], env=environment, stdout=subprocess.PIPE, text=True
    )


def forget(kernel: ModuleType) -> None:
    """Clear a kernel, so that the next call loads it as another process would."""
    store._LOADED.clear()
    del sys.modules[kernel.__name__]


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Point the store to an empty folder, as before any compilation."""
    monkeypatch.setenv(store.CACHE_VARIABLE, str(tmp_path))
    store._announce.cache_clear()
    return tmp_path


def test_second_process_needs_no_computer_algebra(tmp_path: Path) -> None:
    """Assert that of two processes one builds the kernel, and that a later one needs no SymPy."""
    both = [run(OBSERVE, tmp_path) for _ in range(2)]
    first = [process.communicate(timeout=300)[0].split() for process in both]
    assert [process.returncode for process in both] == [0, 0]
    assert first[0][0] == first[1][0]
    assert sorted(imported for _, imported in first) == ["False", "True"]
    later = run(OBSERVE, tmp_path).communicate(timeout=300)[0].split()
    assert later == [first[0][0], "False"]
    assert len(list(tmp_path.glob("*.py"))) == 1
    assert not list(tmp_path.glob("*.tmp"))


def test_built_once_in_the_folder_that_is_named(cache: Path, monkeypatch: Any) -> None:
    """Assert that a kernel is built once, in the folder that the environment names at the call."""
    built = []

    def build() -> str:
        built.append(1)
        return "VALUE = 1\n"

    first = store.load_kernel("test", ["built once"], build)
    forget(first)
    second = store.load_kernel("test", ["built once"], build)
    assert second.VALUE == len(built) == 1
    assert Path(str(second.__file__)).parent == cache
    moved = cache / "moved"
    monkeypatch.setenv(store.CACHE_VARIABLE, str(moved))
    store.load_kernel("there", ["x"], lambda: "THERE = True\n")
    assert len(list(cache.glob("*.py"))) == len(list(moved.glob("*.py"))) == 1


def test_another_recipe_is_another_kernel(cache: Path) -> None:
    """Assert that kernels differ by task, declarations, and templates in their order."""
    source = "from numba import njit\nPLACE = {}\n"
    recipes = [("a", ["x"], ()), ("a", ["y"], ()), ("b", ["x"], ()), ("a", ["x", ""], ())]
    recipes += [("a", ["x"], t) for t in (("status",), ("status", "run_status"))]
    recipes += [("a", ["x"], ("run_status", "status"))]
    names = [
        store.load_kernel(task, declarations, partial(source.format, len(declarations)), templates)
        for task, declarations, templates in recipes
    ]
    assert len({str(kernel.__file__) for kernel in names}) == 6  # the second equals the first
    assert len(list(cache.glob("derived/*.py"))) == 4


def test_changed_generator_derives_anew_but_compiles_only_what_differs(
    cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Assert that a changed derivation with the same text does not recompile the kernel."""
    texts = iter(["VALUE = 1\n", "VALUE = 1\n", "VALUE = 2\n"])
    names = []
    for edit in ("first", "a comment", "a term"):
        monkeypatch.setattr(store, "_generator_digest", lambda edit=edit: edit)
        names.append(store.load_kernel("edited", ["x"], lambda: next(texts)).__name__)
    assert names[0] == names[1] != names[2]
    assert len(list(cache.glob("*.py"))) == 2


def test_what_cannot_be_saved_is_compiled_all_the_same(cache: Path, monkeypatch: Any) -> None:
    """Assert that a full disk does not prevent compilation."""

    def full(*_: object) -> None:
        raise OSError("no space left")

    monkeypatch.setattr("numba.core.caching.IndexDataCacheFile.save", full)
    text = "from numba import njit\n\n\n@njit(cache=True)\ndef twice(x):\n    return 2.0 * x\n"
    kernel = store.load_kernel("test", ["full disk"], lambda: text)
    assert kernel.twice(1.5) == 3.0
    assert not list(cache.rglob("*.nbc"))


def test_compiling_is_announced_once(cache: Path, caplog: pytest.LogCaptureFixture) -> None:
    """Assert that compilation is announced once per process, and not if all is compiled."""
    name = "flexid.kernels.store"
    for kernel, announced in (("said", 1), ("said again", 0)):
        with caplog.at_level("INFO", name):
            store.load_kernel(kernel, ["x"], lambda: KERNEL).double(2)
        assert len(caplog.records) == announced
        caplog.clear()
    store._announce.cache_clear()
    kernel = store.load_kernel("said", ["x"], lambda: KERNEL)
    forget(kernel)
    with caplog.at_level("INFO", name):
        store.load_kernel("said", ["x"], lambda: KERNEL).double(3)
    assert not caplog.records


KERNEL = """
from numba import njit

@njit(cache=True)
def double(x):
    return 2 * x
"""


def test_failed_and_damaged_builds(cache: Path) -> None:
    """Assert that a failed build leaves nothing, and that an empty index alone is rebuilt."""

    def build() -> str:
        raise ValueError("no source")

    with pytest.raises(ValueError, match="no source"):
        store.load_kernel("broken", ["fails"], build)
    assert {file.suffix for file in cache.rglob("*.*")} == {".lock"}
    assert not [name for name in sys.modules if name.startswith("flexid_broken_")]
    kernel = store.load_kernel("damage", ["x"], lambda: KERNEL)
    assert kernel.double(2) == 4
    begun = cache / "__pycache__" / f"{kernel.__name__}.double-5.py311.2.nbc.tmp.0123"
    begun.touch()
    forget(kernel)
    (index,) = cache.glob("__pycache__/*.nbi")
    index.write_bytes(b"")
    assert store.load_kernel("damage", ["x"], lambda: KERNEL).double(3) == 6
    assert begun.exists()


def no_locks(*_: object) -> None:
    """Fail like a file system without locks."""
    raise NotImplementedError("no locks here")


UNUSABLE: dict[str, tuple[str, str, str, Any, str]] = {
    "no folder": ("new", "file/cache", "", None, r"file/cache cannot .*FLEXID_CACHE_DIR"),
    # Existing kernels are not loaded either if numba cannot save.
    "only to be read": ("here", "", "os.access", lambda *_: False, r"\(Permission denied\)"),
    "no locks": ("new", "", "filelock.FileLock.acquire", no_locks, r"\(no locks here\)"),
}


@pytest.mark.parametrize("case", UNUSABLE)
def test_a_cache_that_cannot_be_used_is_refused(cache: Path, monkeypatch: Any, case: str) -> None:
    """Assert that an unusable cache is refused, with the folder and the remedy."""
    task, place, broken, by, words = UNUSABLE[case]
    forget(store.load_kernel("here", ["x"], lambda: KERNEL))
    (cache / "file").write_text("")
    monkeypatch.setenv(store.CACHE_VARIABLE, str(cache / place))
    if broken:
        monkeypatch.setattr(broken, by)
    with pytest.raises(SettingError, match=words):
        store.load_kernel(task, ["x"], lambda: KERNEL)


PAIRS = """
from collections import namedtuple
from numba import njit

Pair = namedtuple("Pair", "a b")

@njit(cache=True)
def total(pair):
    return pair.a + pair.b
"""


def test_an_index_may_name_a_kernel_that_is_not_loaded(cache: Path) -> None:
    """Assert that a compiled signature with the type of an absent kernel is harmless."""
    one, two = (store.load_kernel(name, [name], lambda: PAIRS) for name in ("pairs_a", "pairs_b"))
    assert two.total(one.Pair(1.0, 2.0)) == 3.0
    assert list(cache.glob(f"__pycache__/{two.__name__}.*.nbi"))
    for kernel in (one, two):
        forget(kernel)
    again = store.load_kernel("pairs_b", ["pairs_b"], lambda: PAIRS)
    assert again.total(again.Pair(1.0, 3.0)) == 4.0


def test_threads_wait_for_each_other(cache: Path) -> None:
    """Assert that a thread waits for an import by another, and for the lock of a kernel."""
    source = "import time\ntime.sleep(0.3)\nWHOLE = True\n"

    def load(_: int) -> bool:
        return bool(store.load_kernel("threads", ["x"], lambda: source).WHOLE)

    with ThreadPoolExecutor(4) as pool:
        assert all(pool.map(load, range(4)))
    kernel = store.load_kernel("waiting", ["x"], lambda: KERNEL)
    lock = FileLock(Path(str(kernel.__file__)).with_suffix(".lock"))
    with ThreadPoolExecutor(1) as pool:
        with lock:
            doubled = pool.submit(kernel.double, 2)
            with pytest.raises(TimeoutError):
                doubled.result(timeout=2.0)
            assert not list(cache.glob("__pycache__/*.nbi"))
        assert doubled.result(timeout=60.0) == 4
    assert len(list(cache.glob("__pycache__/*.nbi"))) == 1


FOLDER = Path(store.__file__).parent / "derived"
JOINT, STIFF = flexible(), rigid()
KERNELS = [
    ("estimators.segmented_motion", "motion_kernel", JOINT.systems[0]),
    ("estimators.segmented_motion", "motion_kernel", JOINT.systems[1]),
    ("estimators.segmented_motion", "motion_kernel", STIFF.systems[0]),
    ("kernels.store", "model_kernel", "signals", JOINT.smooth),
    ("kernels.store", "model_kernel", "signals", STIFF.smooth),
]
"""Kernels that `flexid identify` needs for a usual drive: module, function, its arguments."""


@pytest.fixture
def generated(monkeypatch: pytest.MonkeyPatch) -> dict[str, str]:
    """Return each generated source by the name of its file."""
    found: dict[str, str] = {}

    def build_only(
        task: str, declarations: list[str], build: Callable[[], str], _templates: Any = ()
    ) -> ModuleType:
        found[store.shipped_name(task, declarations)] = build()
        return ModuleType(task)

    for name, function, *arguments in KERNELS:
        module = import_module(f"flexid.{name}")
        monkeypatch.setattr(module, "load_kernel", build_only)
        vars(module)[function](*arguments)
    return found


def test_shipped_sources_are_those_that_are_generated(generated: dict[str, str], request: Any):
    """Assert that shipped files equal the generated ones; --update-golden writes them."""
    if request.config.getoption("--update-golden"):
        FOLDER.mkdir(exist_ok=True)
        for path in FOLDER.iterdir():
            path.unlink()
        for name, text in generated.items():
            (FOLDER / name).write_text(text, "utf-8")
    assert {path.name: path.read_text("utf-8") for path in FOLDER.iterdir()} == generated


TEMPLATES = Path(store.__file__).parent / "templates"
DRIVEN = flexible_joint(known={"beta1": 3.0})


def test_stub_has_the_arguments_that_are_generated() -> None:
    """Assert that the stub's signatures are those of the generated functions."""
    declaration = LoopDeclaration(DRIVEN, pd_gravity(), sinusoid(1.0, 2.0))
    law = compose_loop(declaration)
    sources = [
        compiled_signals(DRIVEN),
        sensitivity_functions(DRIVEN, "Test"),
        sampled_loop_source(declaration),
        stiff_loop_source(law),
        lane_loop_source(law, 2),
    ]
    generated = {name: value for source in sources for name, value in signatures(source).items()}
    stub = signatures((TEMPLATES / "generated.pyi").read_text("utf-8"))
    assert stub.items() <= generated.items()


def signatures(source: str) -> dict[str, list[str]]:
    """Return the arguments of each function in a source, by name."""
    functions = [node for node in ast.parse(source).body if isinstance(node, ast.FunctionDef)]
    return {f.name: [argument.arg for argument in f.args.args] for f in functions}
