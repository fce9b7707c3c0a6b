"""Help and completion: whole sentences and valid examples; modules that a command loads."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from flexid.cli.commands import command_line
from flexid.cli.options import sentences
from flexid.models.flexible_joint import SHAPE_TERMS, TERMS

GROUP = command_line()
COMMANDS = sorted(GROUP.commands)


@pytest.mark.parametrize("command", COMMANDS)
def test_help_of_a_command(flexid, command):
    """Assert that -h shows examples, exit status and no Python types, within 80 columns."""
    page = flexid(command, "-h").stdout
    assert page == flexid(command, "--help").stdout
    assert "Examples:\n    flexid" in page
    assert "Exit status:" in page
    assert not re.search(r"<(list|str|float|int|path)\b|list\[", page)
    assert not re.search(r"\btold\b", page)
    assert max(map(len, page.splitlines())) <= 80


def examples():
    """Return each example of every command."""
    for command in GROUP.commands.values():
        yield from re.findall(r"^  flexid (.*)$", command.epilog or "", re.MULTILINE)


@pytest.mark.parametrize("example", [*examples()])
def test_examples_are_accepted(example, tmp_path, monkeypatch):
    """Assert that every example in the help is a valid command line."""
    monkeypatch.chdir(tmp_path)
    name, *arguments = example.split()
    command = GROUP.commands[name]
    context = command.make_context(name, arguments)
    assert context.params


# Packages that take a quarter of a second or more to import, and that a log in SI units with
# existing kernels does not need.
HEAVY = ["sympy", "matplotlib"]
HEAVY += ["scipy.interpolate", "scipy.optimize", "scipy.signal", "scipy.stats"]
IDENTIFY = f"""
import sys
from flexid.cli.main import main
try:
    main()
except SystemExit as end:
    assert end.code == 0, end.code
print([name for name in {HEAVY} if name in sys.modules], file=sys.stderr)
"""


def test_commands_start_light(examples: Path, flexid):
    """Assert that a command loads no other's modules, and a second identification nothing slow."""
    code = (
        "import sys; from flexid.cli.main import main; sys.argv = ['flexid', 'derive', 'x.toml']\n"
        "try: main()\nexcept SystemExit: print('flexid.library.identify' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout == "False\n"
    command = [sys.executable, "-c", IDENTIFY, "identify", str(examples / "flexible_joint.csv")]
    assert flexid(*command[3:]).status == 0  # kernels may be missing
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stderr.splitlines()[-1] == "[]"


def test_lists_are_whole(flexid):
    """Assert whole first sentences of all commands, and every term of a joint."""
    page = flexid("--help").stdout
    assert "..." not in page.replace("[ARGS]...", "")
    for name in COMMANDS:
        (line,) = re.findall(rf"^  {name} .*$", page, re.MULTILINE)
        assert line.endswith("."), line
    page = flexid("identify", "--help").stdout
    assert all(name in page for name in (*TERMS, *SHAPE_TERMS))


@pytest.mark.parametrize("text", ["What it is. As `flexid.read_log` takes it.", "What it is."])
def test_what_only_python_has_is_not_in_the_help(text):
    """Assert that sentences with names of Python are omitted from the help."""
    assert sentences(text) == "What it is."


def test_module_and_completion():
    """Assert that the package runs as a module, and that the shell completes its commands."""
    done = subprocess.run(
        [sys.executable, "-m", "flexid", "--version"], capture_output=True, text=True, check=True
    )
    assert re.fullmatch(r"flexid \S+\n", done.stdout)
    environment = os.environ | {
        "_FLEXID_COMPLETE": "bash_complete",
        "COMP_WORDS": "flexid id",
        "COMP_CWORD": "1",
    }
    code = "import sys; sys.argv = ['flexid']; from flexid.cli.main import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True
    )
    assert done.stdout.split() == ["plain,identify"]
