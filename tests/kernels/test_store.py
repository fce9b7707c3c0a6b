"""The cache of generated kernels."""

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from flexid.kernels import store

SIMULATE = """
import sys
from flexid.control.references import sinusoid
from flexid.control.pd_gravity import pd_gravity
from flexid.models.flexible_joint import flexible_joint
from flexid.simulation.sampled import simulate_sampled
from flexid.simulation.loop import ClosedLoop
loop = ClosedLoop(
    flexible_joint(known={"beta1": 3.0}),
    {"theta1": 5.0, "theta2": 100.0, "alpha1": 300.0, "alpha2": 0.3},
    pd_gravity(), sinusoid(1.0, 2.0), {"link": 1.0, "motor": 1.0},
)
print(repr(simulate_sampled(loop, 0.1).states[-1, 0]), "sympy" in sys.modules)
"""


def run(code: str, cache: Path) -> subprocess.Popen[str]:
    """Start Python on some code with its own cache."""
    environment = {**os.environ, store.CACHE_VARIABLE: str(cache)}
    return subprocess.Popen(
        [sys.executable, "-c", code], env=environment, stdout=subprocess.PIPE, text=True
    )


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Point the store to an empty folder."""
    monkeypatch.setenv(store.CACHE_VARIABLE, str(tmp_path))
    store.cache_directory.cache_clear()
    yield tmp_path
    store.cache_directory.cache_clear()


def test_second_process_needs_no_computer_algebra(tmp_path: Path) -> None:
    """Assert that processes that start at once agree, and that a later one never imports SymPy."""
    both = [run(SIMULATE, tmp_path) for _ in range(2)]
    first = [process.communicate(timeout=300)[0].split() for process in both]
    assert [process.returncode for process in both] == [0, 0]
    assert first[0] == first[1]
    assert first[0][1] == "True"
    later = run(SIMULATE, tmp_path).communicate(timeout=300)[0].split()
    assert later == [first[0][0], "False"]
    assert len(list(tmp_path.glob("*.py"))) == 1
    assert not list(tmp_path.glob("*.tmp"))


def test_built_once(cache: Path) -> None:
    """Assert that a kernel is built on its first call only, and lands in the named folder."""
    built = []

    def build() -> str:
        built.append(1)
        return "VALUE = 1\n"

    first = store.load_kernel("test", ["built once"], build)
    del sys.modules[first.__name__]
    second = store.load_kernel("test", ["built once"], build)
    assert second.VALUE == 1
    assert len(built) == 1
    assert Path(str(second.__file__)).parent == cache


def test_threads_find_whole_modules(cache: Path) -> None:
    """Assert that a thread that asks while another one imports waits for the whole module."""
    source = "import time\ntime.sleep(0.3)\nWHOLE = True\n"

    def load(_: int) -> bool:
        return bool(store.load_kernel("threads", ["x"], lambda: source).WHOLE)

    with ThreadPoolExecutor(4) as pool:
        assert all(pool.map(load, range(4)))


def test_changed_declaration_is_built_anew(cache: Path) -> None:
    """Assert that another declaration or task is another kernel."""
    kernels = [
        store.load_kernel(task, declarations, lambda: "")
        for task, declarations in [("a", ["x"]), ("a", ["y"]), ("b", ["x"]), ("a", ["x", ""])]
    ]
    assert len({kernel.__name__ for kernel in kernels}) == 4
    assert len(list(cache.glob("*.py"))) == 4


def test_changed_recipe_is_built_anew(cache: Path) -> None:
    """Assert that other templates, or the same in another order, make another kernel."""
    recipes = [("status",), ("status", "free_run"), ("free_run", "status"), ()]
    source = "from numba import njit\n"
    names = {
        store.load_kernel("recipe", ["x"], lambda: source, recipe).__name__ for recipe in recipes
    }
    assert len(names) == 4


def test_failed_build_leaves_nothing(cache: Path) -> None:
    """Assert that a build that fails neither leaves a file nor a module behind."""

    def build() -> str:
        raise ValueError("no source")

    with pytest.raises(ValueError, match="no source"):
        store.load_kernel("broken", ["fails"], build)
    assert not list(cache.iterdir())
    assert not [name for name in sys.modules if name.startswith("flexid_broken_")]


def test_fallback_is_private(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Assert that without a writable cache kernels go to a new folder that is the user's alone."""
    (tmp_path / "file").write_text("")
    monkeypatch.setenv(store.CACHE_VARIABLE, str(tmp_path / "file" / "cache"))
    store.cache_directory.cache_clear()
    try:
        directory = store.cache_directory()
        assert not list(directory.iterdir())
        assert directory.stat().st_mode & 0o077 == 0
    finally:
        store.cache_directory.cache_clear()


KERNEL = """
from numba import njit

@njit(cache=True)
def double(x):
    return 2 * x
"""


@pytest.mark.parametrize("damage", ["source", "index"])
def test_damaged_files_are_made_anew(cache: Path, damage: str) -> None:
    """Assert that a source cut short, or an emptied index of compiled code, does no harm."""
    kernel = store.load_kernel("damage", [damage], lambda: KERNEL)
    assert kernel.double(2) == 4
    del sys.modules[kernel.__name__]
    if damage == "source":
        path = Path(str(kernel.__file__))
        path.write_text(path.read_text()[:40])
    else:
        (index,) = cache.glob("__pycache__/*.nbi")
        index.write_bytes(b"")
    assert store.load_kernel("damage", [damage], lambda: KERNEL).double(3) == 6
