"""The fenced blocks of a page, and what is to be done with each.

A page may say of the block that follows, in a comment that no reader sees::

    <!-- file: joint.toml -->          it is a file that the blocks after it use
    <!-- not run: takes a minute -->   it is not run, and why
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGES = (
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    *sorted((ROOT / "docs").rglob("*.md")),
)

_DIRECTIVE = re.compile(r"<!-- (file|not run): (.+) -->")
_FENCE = re.compile(r"(`{3,})(.*)")


@dataclass(frozen=True)
class Block:
    """A fenced block of a page.

    ``line`` is that of its first line of text, ``follows`` whether nothing but blank lines stands
    between it and the block before.
    """

    language: str
    text: str
    line: int
    follows: bool
    file: str | None = None
    not_run: str | None = None


def page_name(page: Path) -> str:
    """Return how a page is called in this repository."""
    return page.relative_to(ROOT).as_posix()


def blocks(text: str) -> list[Block]:
    """Return the fenced blocks of a page in their order."""
    found: list[Block] = []
    directive: dict[str, str] = {}
    follows = False
    lines = iter(enumerate(text.splitlines(), start=1))
    for number, line in lines:
        if fence := _FENCE.fullmatch(line):
            content = _until(lines, fence[1])
            found.append(
                Block(
                    language=fence[2].strip(),
                    text="".join(f"{one}\n" for one in content),
                    line=number + 1,
                    follows=follows,
                    file=directive.get("file"),
                    not_run=directive.get("not run"),
                )
            )
            directive, follows = {}, True
        elif said := _DIRECTIVE.fullmatch(line):
            directive[said[1]] = said[2]
        elif line.strip():
            directive, follows = {}, False
    return found


def indented_code(text: str) -> list[int]:
    """Return the lines at which code begins that is indented instead of fenced."""
    found, before, blank, inside = [], "", True, False
    for number, line in enumerate(text.splitlines(), start=1):
        if line.startswith("```"):
            inside = not inside
        item = re.match(r" *([-*]|\d+\.) ", before) or before.startswith("  ")
        if not inside and blank and line.startswith("    ") and line.strip() and not item:
            found.append(number)
        blank = not line.strip()
        before = line if line.strip() else before
    return found


def _until(lines: enumerate[str], fence: str) -> list[str]:
    """Return the lines up to the fence that closes a block."""
    content = []
    for _, line in lines:
        if line == fence:
            return content
        content.append(line)
    raise ValueError("a block is not closed")
