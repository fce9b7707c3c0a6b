"""Names offered by `import flexid`: loaded on use, typed, documented, consistent with commands."""

import ast
import inspect
import pkgutil
import re
import subprocess
import sys
from pathlib import Path

import pytest

import flexid

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
