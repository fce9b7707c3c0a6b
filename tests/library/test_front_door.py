"""Names of `import flexid`: loaded on use, typed, documented; one thread during a call."""

import ast
import inspect
import os
import pkgutil
import re
import subprocess
import sys
import threading
from pathlib import Path
from unittest.mock import Mock

import pytest

import flexid
from flexid.library.arguments import one_thread

HOMES: dict[str, str] = vars(flexid)["_MODULES"]
NAMES: list[str] = vars(flexid)["__all__"]


HEAVY = {"numpy", "scipy", "numba", "sympy", "polars", "matplotlib", "pydantic", "rich", "click"}

LOADED = "import sys, flexid; print(*sorted({name.partition('.')[0] for name in sys.modules}))"


def offered(kind):
    """Return the public names that are functions, or classes."""
    return [name for name in NAMES if kind(getattr(flexid, name))]


def test_importing_loads_nothing():
    """Assert that no other library is loaded by the import alone."""
    done = subprocess.run(
        [sys.executable, "-c", LOADED], capture_output=True, text=True, check=True
    )
    assert not HEAVY & set(done.stdout.split())


def test_types_and_run_time_agree():
    """Assert that each import of the stub exists at run time."""
    (package,) = flexid.__path__
    tree = ast.parse((Path(package) / "__init__.pyi").read_text(encoding="utf-8"))
    typed = {
        alias.asname: node.module
        for node in tree.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    there = {name: f"flexid.{home}" for name, home in HOMES.items()}
    assert typed == there
    assert (Path(package) / "py.typed").exists()


def test_names_of_the_package():
    """Assert that names are listed and no module hides one, and an answer to a misspelt one."""
    for name in NAMES:
        assert getattr(flexid, name) is not None
    assert set(NAMES) <= set(dir(flexid))
    modules = {module.name for module in pkgutil.iter_modules(flexid.__path__)}
    assert not modules & set(NAMES)
    with pytest.raises(AttributeError, match="identfy") as caught:
        getattr(flexid, "identfy")  # noqa: B009
    assert caught.value.name == "identfy"
    assert caught.value.obj is flexid


@pytest.mark.parametrize("name", [*offered(inspect.isfunction)])
def test_every_argument_is_documented(name):
    """Assert that a function's docstring documents its parameters, and no others."""
    function = getattr(flexid, name)
    assert documented(function.__doc__) == set(inspect.signature(function).parameters)


@pytest.mark.parametrize("name", [*offered(inspect.isclass)])
def test_every_method_is_documented(name):
    """Assert that public methods are documented, with every parameter."""
    for member, thing in inspect.getmembers(getattr(flexid, name)):
        if member.startswith("_") or "flexid" not in (getattr(thing, "__module__", "") or "flexid"):
            continue
        if isinstance(thing, property):
            assert thing.__doc__, member
        elif inspect.isfunction(thing):
            own = set(inspect.signature(thing).parameters) - {"self"}
            assert documented(thing.__doc__) == own, member


def documented(docstring):
    """Return the names in the section on parameters of a docstring."""
    assert docstring
    section = re.search(
        r"\n *Parameters\n *-+\n(.*?)(\n *\n *\w+\n *-+\n|\Z)", docstring, re.DOTALL
    )
    if section is None:
        return set()
    heads = re.findall(r"^( *)((?:\*{0,2}\w+, )*\*{0,2}\w+)(?: :.*)?$", section[1], re.MULTILINE)
    indent = min(len(blanks) for blanks, _ in heads)
    lists = (names for blanks, names in heads if len(blanks) == indent)
    return {name.strip().lstrip("*") for names in lists for name in names.split(",")}


REPORT = """
import sys
import threadpoolctl
import scipy.linalg

def counts():
    return {p["num_threads"] for p in threadpoolctl.threadpool_info() if p["user_api"] == "blas"}

import flexid.identification.identify as module

def seen(logs, *_):
    print(*counts())
    raise flexid.SettingError("stop", "here")

import flexid
module.identify = seen
before = counts()
try:
    RUN
except (flexid.SettingError, SystemExit):
    pass
print("as before" if counts() == before else "changed")
"""

CALLS = {
    "library": "flexid.identify(sys.argv[1])",
    "command": "sys.argv[1:1] = ['identify']; from flexid.cli.main import main; main()",
}


@pytest.mark.parametrize("call", CALLS)
def test_whoever_calls_gets_one_thread(examples, call):
    """Assert that a call uses one thread, with two for other code."""
    others = {name: value for name, value in os.environ.items() if name != "OMP_NUM_THREADS"}
    script = REPORT.replace("RUN", CALLS[call])
    done = subprocess.run(
        [sys.executable, "-c", script, str(examples / "flexible_joint.csv")],
        env=others | {"OPENBLAS_NUM_THREADS": "2"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.split() == ["1", "as", "before"]


def test_calls_at_once_share_a_limit(monkeypatch):
    """Assert that overlapping calls share one limit, removed by the last to end."""
    limits = Mock()
    monkeypatch.setattr("threadpoolctl.threadpool_limits", limits)
    first_is_in, second_is_in = threading.Event(), threading.Event()

    def first():
        with one_thread():
            first_is_in.set()
            second_is_in.wait()

    thread = threading.Thread(target=first)
    thread.start()
    first_is_in.wait()
    with one_thread():
        second_is_in.set()
        thread.join()
        limits.assert_called_once_with(limits=1, user_api="blas")
        limits.return_value.restore_original_limits.assert_not_called()
    limits.return_value.restore_original_limits.assert_called_once_with()
