"""Run the blocks of a page in order, as a reader would."""

import contextlib
import io
import os
import shlex
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest.mock import patch

from page_blocks import ROOT, Block
from page_output import agrees

from flexid.cli.main import main

# Directives of Sphinx, checked by the build of the pages.
_DIRECTIVES = "{"

# Syntax that only a shell can run.
_SHELL = {"|", "||", "&&", ">", "<"}


class PageError(AssertionError):
    """A block that fails, or whose output differs from the page."""


@dataclass
class Reader:
    """State of a page's reader: variables of Python, the last exit status, the last output."""

    page: str
    names: dict[str, Any]
    status: int = 0
    printed: str | None = None

    def follow(self, block: Block) -> None:
        """Run a block, and compare its output with the page."""
        before, self.printed = self.printed, None
        if block.language.startswith(_DIRECTIVES) or block.not_run is not None:
            return
        if block.file is not None:
            path = Path(block.file)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(block.text, encoding="utf-8")
        elif block.language == "console":
            self._type(block)
        elif block.language == "python":
            self._execute(block)
        elif block.language == "toml":
            tomllib.loads(block.text)
        elif block.language == "text" and block.follows and before is not None:
            self._compare(block.line, block.text, before)
        else:
            raise PageError(
                f"{self.page}:{block.line}: nothing says what this {block.language} is: the "
                "output of the Python above, a file, or not run and why"
            )

    def _type(self, block: Block) -> None:
        """Run the commands of a console, each of which may be followed by its output."""
        for line, command, shown in commands(block):
            if command == "echo $?":
                printed, self.status = f"{self.status}\n", 0
            else:
                self._leave(line)
                self.status, printed = command_output(command)
            if shown:
                self._compare(line, shown, printed)
            if self.status and not shown:
                self._leave(line, printed)
        self._leave(block.line)

    def _leave(self, line: int, printed: str = "") -> None:
        """Fail if a command failed and the page does not show it."""
        if self.status:
            raise PageError(f"{self.page}:{line}: exit status {self.status}\n{printed}")

    def _execute(self, block: Block) -> None:
        """Run Python with the variables of earlier blocks."""
        # Empty lines give a traceback the page's line numbers.
        code = compile("\n" * (block.line - 1) + block.text, self.page, "exec")
        with _captured() as output:
            exec(code, self.names)
        self.printed = output.getvalue()

    def _compare(self, line: int, shown: str, printed: str) -> None:
        """Fail if the output differs from the page."""
        if not agrees(shown, printed):
            raise PageError(f"{self.page}:{line}: shown is\n{shown}\nbut printed is\n{printed}")


def run_page(page: str, found: list[Block], folder: Path) -> None:
    """Run the blocks of a page in an empty folder, with the examples of this repository.

    A block that fails, or whose output differs from the page, is a `PageError`.
    """
    for shared in ("examples", "experiments"):
        (folder / shared).symlink_to(ROOT / shared)
    reader = Reader(page, {"__name__": "__main__"})
    with contextlib.chdir(folder), patch.dict(os.environ, {"COLUMNS": "80"}):
        for block in found:
            reader.follow(block)


def commands(block: Block) -> Iterator[tuple[int, str, str]]:
    """Yield line, command and shown output of each command of a console."""
    command, shown, start = "", "", 0
    lines = enumerate(block.text.splitlines(), start=block.line)
    for number, line in lines:
        if line.startswith("$ "):
            if command:
                yield start, command, shown
            start, command, shown = number, line[2:], ""
            while command.endswith("\\"):
                command = command[:-1] + next(lines)[1]
        else:
            shown += f"{line}\n"
    if command:
        yield start, command, shown


def command_output(command: str) -> tuple[int, str]:
    """Run a command; return its exit status and what it printed."""
    words = shlex.split(command, comments=True)
    if words[0] == "flexid" and _SHELL.isdisjoint(words):
        return _flexid(words)
    folders = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        command,
        shell=True,
        env={**os.environ, "PATH": folders},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )
    return done.returncode, done.stdout


def _flexid(words: list[str]) -> tuple[int, str]:
    """Run ``flexid`` in this process, whose kernels are loaded."""
    status = 0
    with _captured() as output, patch.object(sys, "argv", words):
        try:
            main()
        except SystemExit as stopped:
            status = int(stopped.code or 0)
    return status, output.getvalue()


@contextlib.contextmanager
def _captured() -> Iterator[io.StringIO]:
    """Collect output and errors, as in a terminal."""
    output = io.StringIO()
    with contextlib.redirect_stdout(output), contextlib.redirect_stderr(output):
        yield output
