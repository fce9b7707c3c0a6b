"""Help: whole sentences, examples that parse, types that can be read; and completion."""

import importlib
import os
import re
import subprocess
import sys

import pytest
import typer

from flexid.cli.commands import app

GROUP = typer.main.get_command(app)
COMMANDS = sorted(GROUP.commands)  # type: ignore[attr-defined]


def test_no_summary_is_cut(flexid):
    """Assert that each command stands in the list with its whole first sentence."""
    page = flexid("--help").stdout
    assert "..." not in page.replace("[ARGS]...", "")
    for name in COMMANDS:
        (line,) = re.findall(rf"^  {name} .*$", page, re.MULTILINE)
        assert line.endswith("."), line


@pytest.mark.parametrize("command", COMMANDS)
def test_help_of_a_command(flexid, command):
    """Assert that -h shows examples, the exit status, and no Python types, within 80 columns."""
    page = flexid(command, "-h").stdout
    assert page == flexid(command, "--help").stdout
    assert "Examples:\n    flexid" in page
    assert "Exit status:" in page
    assert not re.search(r"<(list|str|float|int|path)\b|list\[", page)
    assert not re.search(r"\btold\b", page)
    assert max(map(len, page.splitlines())) <= 80


def examples():
    """Return each example of every command."""
    for command in COMMANDS:
        yield from importlib.import_module(f"flexid.cli.{command}").EXAMPLES


@pytest.mark.parametrize("example", [*examples()])
def test_examples_are_accepted(example, tmp_path, monkeypatch):
    """Assert that the command line takes every example of its help."""
    monkeypatch.chdir(tmp_path)
    name, *arguments = example.split()
    command = GROUP.commands[name]  # type: ignore[attr-defined]
    context = command.make_context(name, arguments)
    assert context.params


def test_python_m_flexid():
    """Assert that the package runs as a module."""
    done = subprocess.run(
        [sys.executable, "-m", "flexid", "--version"], capture_output=True, text=True, check=True
    )
    assert re.fullmatch(r"flexid \S+\n", done.stdout)


def test_the_shell_completes_commands():
    """Assert that the shell's completion offers the commands."""
    environment = os.environ | {
        "_FLEXID_COMPLETE": "complete_bash",
        "COMP_WORDS": "flexid id",
        "COMP_CWORD": "1",
    }
    code = "import sys; sys.argv = ['flexid']; from flexid.cli.main import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True
    )
    assert done.stdout.split() == ["identify"]


def test_identify_and_excitation_have_the_same_settings():
    """Assert that what decides an identification can be said to both commands."""
    found = {
        name: {option for p in GROUP.commands[name].params for option in p.opts}  # type: ignore[attr-defined]
        for name in ("identify", "excitation")
    }
    assert found["identify"] - found["excitation"] == {"--stream", "--explain"}
    assert not found["excitation"] - found["identify"]
