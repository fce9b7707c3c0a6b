"""The page on reliability names tests; they exist."""

import ast
import re
from pathlib import Path

ROOT = Path(__file__).parents[2]


def named_tests() -> list[tuple[str, str]]:
    """Every file of tests that the page names, with a test in it, or an empty name for all."""
    found, file = [], ""
    for name in re.findall(r"`(tests/[\w/]+\.py(?:::\w+)?|::\w+)`", page()):
        file, _, test = name.rpartition("::") if "::" in name else (name, "", "")
        found.append((file or found[-1][0], test))
    return found


def page() -> str:
    """The page's text."""
    return (ROOT / "docs" / "reliability.md").read_text(encoding="utf-8")


def test_every_test_exists():
    """Assert that each file exists and has the test that the page names."""
    assert len(named_tests()) > 30
    for file, name in named_tests():
        tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))
        functions = {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}
        assert not name or name in functions, f"{file}::{name}"


def test_every_fault_has_a_test():
    """Assert that no row of the tables of faults is without a test."""
    rows = [line for line in page().partition("## Fuzzing")[0].splitlines() if line[:1] == "|"]
    assert all("`tests/" in row for row in rows if not row.startswith(("| Fault", "|---")))
