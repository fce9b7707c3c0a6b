"""Blocks of documentation pages, between two marks, that benchmarks write."""

from pathlib import Path


def write_block(page: Path, name: str, block: str) -> None:
    """Replace the block of a name in a file; raises like `with_block`."""
    text = with_block(page.read_text(encoding="utf-8"), name, block)
    page.write_text(text, encoding="utf-8")


def with_block(page: str, name: str, block: str) -> str:
    """Return the page with the block of a name replaced.

    Raises
    ------
    ValueError
        If the page does not contain both marks once.
    """
    begin, end = _marks(name)
    if page.count(begin) != 1 or page.count(end) != 1:
        raise ValueError(f"the page does not have {begin} and {end} once each: write them")
    before, _, rest = page.partition(begin)
    return f"{before}{begin}\n\n{block}\n{end}{rest.partition(end)[2]}"


def block_of(page: str, name: str) -> str:
    """Return the block of a name."""
    begin, end = _marks(name)
    return page.partition(f"{begin}\n\n")[2].partition(f"\n{end}")[0]


def _marks(name: str) -> tuple[str, str]:
    return f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
