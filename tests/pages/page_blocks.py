"""The fenced blocks of a page, and how each is treated.

The line before a block may give the file that a reader saves it as::

    Save as `joint.toml`:

A comment before a block, which the rendered page does not show, leaves the block out::

    <!-- not run: takes a minute -->
"""

import re
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGES = (ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md")))

_NOT_RUN = re.compile(r"<!-- not run: (.+) -->")
_FILE = re.compile(r"(?:.* )?[Ss]ave (?:it |this |them )?as `([^`]+)`:")
_FENCE = re.compile(r"(`{3,})(.*)")


@dataclass(frozen=True)
class Block:
    """A fenced block of a page.

    ``line`` is its first line of text. ``follows`` is whether only blank lines separate it from the
    block before.
    """

    language: str
    text: str
    line: int
    follows: bool
    file: str | None = None
    not_run: str | None = None


def page_name(page: Path) -> str:
    """Return a page's name in this repository."""
    return page.relative_to(ROOT).as_posix()


def blocks(text: str) -> list[Block]:
    """Return the fenced blocks of a page in their order."""
    found: list[Block] = []
    file = not_run = None
    follows = False
    lines = iter(enumerate(text.splitlines(), start=1))
    for number, line in lines:
        if fence := _FENCE.fullmatch(line):
            content = "".join(f"{one}\n" for one in _until(lines, fence[1]))
            language = fence[2].strip()
            found.append(Block(language, content, number + 1, follows, file, not_run))
            file, not_run, follows = None, None, True
        elif comment := _NOT_RUN.fullmatch(line):
            not_run = comment[1]
        elif line.strip():
            caption = _FILE.fullmatch(line)
            file, not_run, follows = caption and caption[1], None, False
    return found


def _until(lines: enumerate[str], fence: str) -> list[str]:
    """Return the lines up to the fence that closes a block."""
    content = []
    for _, line in lines:
        if line == fence:
            return content
        content.append(line)
    raise ValueError("a block is not closed")
