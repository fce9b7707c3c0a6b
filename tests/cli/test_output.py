"""Output of commands, also to full disks and closed streams; help, completion, loaded modules."""

import io
import json
import os
import re
import subprocess
import sys
from pathlib import Path
from unittest.mock import Mock

import pytest
from rich.console import Console

from flexid.cli import generated
from flexid.cli.commands import command_line
from flexid.cli.options import sentences
from flexid.models.flexible_joint import SHAPE_TERMS, TERMS

FULL = Path("/dev/full")
LITTLE_ROOM = """
import resource
import sys
sys.dont_write_bytecode = True  # of which Python would keep the first 50 bytes
resource.setrlimit(resource.RLIMIT_FSIZE, (50, 50))
from flexid.cli.main import main
main()
"""


@pytest.mark.skipif(not FULL.exists(), reason="no device that is always full")
def test_full_disk_is_one_sentence():
    """Assert that output to a full disk exits with 2 and one line."""
    with FULL.open("w") as full:
        outcome = subprocess.run(
            [sys.executable, "-m", "flexid", "--help"],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
        )
    assert outcome.returncode == 2
    assert outcome.stderr.splitlines() == [
        "flexid: the output cannot be written (No space left on device): "
        "make room, or write elsewhere"
    ]


@pytest.mark.skipif(os.name != "posix", reason="a shell that closes streams")
@pytest.mark.parametrize(
    ("closed", "status", "says"),
    [
        (">&-", 2, "flexid: the output cannot be written (it is closed): make room, or write "),
        ("2>&-", 0, ""),
        ("<&- >&- 2>&-", 2, ""),
    ],
)
def test_a_closed_stream_is_no_defect(closed: str, status: int, says: str):
    """Assert that a command works with a closed stream, and that a lost result is an error."""
    command = f'"{sys.executable}" -m flexid derive flexible-joint {closed}'
    done = subprocess.run(command, shell=True, capture_output=True, text=True)
    assert (done.returncode, done.stderr.partition("elsewhere")[0]) == (status, says)


@pytest.mark.skipif(os.name != "posix", reason="limits of processes")
def test_a_full_disk_loses_no_result(examples, tmp_path, flexid):
    """Assert that results are printed though files cannot be written, with one sentence."""
    log, out = tmp_path / "short.csv", tmp_path / "results"
    lines = (examples / "flexible_joint.csv").read_text().splitlines(keepends=True)
    log.write_text("".join(lines[:3000]))
    assert flexid("identify", log).status == 0  # kernels may be missing
    out.mkdir()
    command = [sys.executable, "-c", LITTLE_ROOM, "identify", log, "--out", out]
    done = subprocess.run(command, capture_output=True, text=True)
    assert "joint_stiffness" in done.stdout
    assert done.stderr.splitlines()[-1].endswith(": make room, or write elsewhere")
    assert "cannot be written (File too large)" in done.stderr
    assert done.returncode == 2
    assert list(out.iterdir()) == []


@pytest.mark.parametrize("failing", ["_parts", "_write_files"])
def test_what_fails_does_not_keep_the_rest(tmp_path, failing):
    """Assert that files are written if printing fails, and the reverse."""
    answer = Mock(warnings=(), _parts=Mock(return_value=[]))
    getattr(answer, failing).side_effect = OSError("no room")
    command = Mock(call=Mock(return_value=answer), doing="", more="")
    with pytest.raises(OSError, match="no room"):
        generated.present(command, {}, {"json": False, "out": tmp_path / "results"})
    assert (tmp_path / "results").exists() == (failing == "_parts")
    answer._parts.assert_called_once()
    answer._write_files.assert_called_once()


@pytest.fixture(params=["ascii", "cp1252"])
def printed(request, monkeypatch):
    """Return a function that returns the output on a terminal without Greek letters."""

    def by(printing):
        raw = io.BytesIO()
        stream = io.TextIOWrapper(raw, encoding=request.param, write_through=True)
        with monkeypatch.context() as patched:
            patched.setattr(sys, "stdout", stream)
            generated.replace_what_cannot_be_encoded()
            printing()
        return raw.getvalue().decode(request.param)

    return by


def test_json_without_greek_is_the_same(printed):
    """Assert that JSON does not depend on the terminal's characters."""
    document = {"name": "θ₁ ± é", "value": 1.5}
    assert json.loads(printed(lambda: generated.print_document(document))) == document


@pytest.mark.parametrize(
    ("count", "rest", "lines"),
    [(3, "--explain", 3), (5, "--explain", 4), (5, "", 5), (0, "--explain", 0)],
)
def test_three_warnings_are_printed(count, rest, lines):
    """Assert that the first three of many warnings are printed, with the place of the others."""
    written = io.StringIO()
    console = Console(file=written)
    generated.print_warnings([f"w{number}" for number in range(count)], console, rest)
    printed = written.getvalue().splitlines()
    assert len(printed) == lines
    assert printed[:3] == [f"warning: w{number}" for number in range(min(count, 3))]
    if lines == 4:
        assert printed[-1] == "2 more warnings: see --explain"


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
def test_examples_are_accepted(example, here):
    """Assert that every example in the help is a valid command line."""
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


def test_commands_start_light_and_complete(examples: Path, flexid):
    """Assert modules that a command loads, the package as a module, and the shell's completion."""
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
