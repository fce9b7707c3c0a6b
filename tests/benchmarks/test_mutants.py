"""Mutations of a source, each of which the tests should detect."""

from benchmarks.mutations import changes
from benchmarks.page_block import block_of

from benchmarks import mutants_page


def test_changes_of_a_source():
    """Assert that operators, numbers and keywords change one at a time, and annotations do not."""
    source = 'def f(δ: "int" = 2) -> "a | b":\n    return not δ <= 3.0 and f"{1}"\n'
    found = {whole.decode().removesuffix("\n") for *_, whole in changes(source.encode())}
    for before, after in (
        ("= 2", "= (3)"),
        ('not δ <= 3.0 and f"{1}"', "(not δ <= 3.0 or f'{1}')"),
        ("not δ <= 3.0", "(δ <= 3.0)"),
        ("δ <= 3.0", "(δ < 3.0)"),
        ("δ <= 3.0", "(δ >= 3.0)"),
        ("3.0", "(6.0)"),
    ):
        found.remove(source.replace(before, after).removesuffix("\n"))
    assert not found


def test_the_pages_show_what_is_kept():
    """Assert that table and list on the page match the results, with each survivor judged."""
    results = mutants_page.kept()
    page = mutants_page.PAGE.read_text(encoding="utf-8")
    assert block_of(page, mutants_page.BLOCK) == "\n".join([*mutants_page.table(results), ""])
    assert mutants_page.LIST.read_text(encoding="utf-8") == mutants_page.survivors(results)
    assert "not judged" not in mutants_page.survivors(results)
