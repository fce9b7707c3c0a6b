"""The style of manual and code: wrapped lines, short sentences, and standard words."""

import ast
import re
from pathlib import Path

import pytest
from page_blocks import PAGES, ROOT, page_name

LINE = 100  # characters per line of prose
SENTENCE = 40  # words
MANUAL_PAGES, MANUAL_WORDS = 25, 35_000
README_LINES = 120

DIALECT = re.compile(
    r"\b(be it|beside|whatever|whoever|anew|told|untold|climb\w*"
    r"|as far as|deserves?|feign\w*|next to none|of no account|in the midst)\b",
    re.IGNORECASE,
)
"""Words that must be replaced by standard terms."""

NEGATION = re.compile(r"\b(is|are|was|were|has|have) none\b", re.IGNORECASE)
"""The manual says what there is."""

PROSE_PAGES = (*PAGES, ROOT / "CHANGELOG.md", ROOT / "SECURITY.md")


def prose_lines(page: Path) -> list[tuple[int, str]]:
    """Return the lines of a page with numbers, without code, equations, tables and comments."""
    found: list[tuple[int, str]] = []
    fence = ""
    for number, line in enumerate(page.read_text(encoding="utf-8").splitlines(), start=1):
        if fence:
            fence = "" if line.startswith(fence) else fence
            continue
        marker = re.match(r"`{3,}|\$\$(?!.*\$\$)", line)
        if marker:
            fence = marker[0]
        outside = marker or line.startswith(("|", "<!--", "![", "$$"))
        found.append((number, "" if outside else line))
    return found


def sentences(page: Path) -> list[tuple[int, str]]:
    """Return the sentences of a page's prose, with the lines of their paragraphs."""
    paragraphs: list[tuple[int, list[str]]] = []
    begins = True
    for number, line in prose_lines(page):
        item = re.match(r" *([-*]|\d+\.) ", line)
        if begins or item or line.startswith("#"):
            paragraphs.append((number, []))
        paragraphs[-1][1].append(line)
        begins = not line.strip() or line.startswith("#")
    return [
        (number, sentence)
        for number, lines in paragraphs
        for sentence in re.split(r"(?<=[.!?])[)\"*]*\s+", _plain(" ".join(lines)))
        if sentence.strip()
    ]


def _plain(text: str) -> str:
    """Return prose without addresses of links, with code and formulas as one word each."""
    text = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", text)
    text = re.sub(r"`[^`]*`", "CODE", text)
    return re.sub(r"\$[^$]*\$", "FORMULA", text)


@pytest.mark.parametrize("page", PROSE_PAGES, ids=page_name)
def test_prose_can_be_read(page: Path) -> None:
    """Assert the length of lines and sentences, and standard words."""
    faults = [f"{at}: {line}" for at, line in prose_lines(page) if len(line) > LINE]
    for at, sentence in sentences(page):
        if len([word for word in sentence.split() if re.search(r"\w", word)]) > SENTENCE:
            faults.append(f"{at}: {sentence}")
        for words in (DIALECT, NEGATION):
            faults += [f"{at}: {match[0]}" for match in words.finditer(sentence)]
    assert faults == []


def test_the_manual_is_short() -> None:
    """Assert the maximum lengths of the manual and of the README."""
    manual = [page.read_text(encoding="utf-8") for page in (ROOT / "docs").rglob("*.md")]
    assert len(manual) <= MANUAL_PAGES
    assert sum(len(text.split()) for text in manual) <= MANUAL_WORDS
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= README_LINES


def described(path: Path) -> list[tuple[int, str]]:
    """Return the docstrings and comments of a Python file with their first lines."""
    text = path.read_text(encoding="utf-8")
    kinds = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    nodes = [node for node in ast.walk(ast.parse(text)) if isinstance(node, kinds) and node.body]
    found = [(node.body[0].lineno, ast.get_docstring(node) or "") for node in nodes]
    comments = [re.search(r"(?:^|\s)# (.*)", line) for line in text.splitlines()]
    return found + [(at, match[1]) for at, match in enumerate(comments, start=1) if match]


def test_code_is_described_in_standard_words() -> None:
    """Assert that docstrings and comments use standard words; a docstring names what it returns."""
    faults = [
        f"{path.relative_to(ROOT)}:{at}: {text}"
        for folder in ("src", "tests", "benchmarks", "docs", "examples")
        for path in sorted((ROOT / folder).rglob("*.py"))
        for at, text in described(path)
        if text.startswith("What ") or DIALECT.search(text)
    ]
    assert faults == []
