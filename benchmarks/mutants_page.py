"""Results of `benchmarks.mutants`, and the pages that show them."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from benchmarks.page_block import write_block
from benchmarks.report import markdown

RESULTS, LIST = Path("benchmarks/mutants.json"), Path("benchmarks/mutants.md")
PAGE, BLOCK = Path("docs/reliability.md"), "mutants"

Results = Mapping[str, Mapping[str, Any]]
"""Part, number of changes and survivors, by state and file."""


def keep(state: str, file: str, found: dict[str, Any]) -> None:
    """Store a file's results with the others; notes on survivors are kept."""
    results = kept()
    old = results.setdefault(state, {}).get(file, {"survivors": []})["survivors"]
    notes = {(s["before"], s["after"]): s["note"] for s in old}
    for survivor in found["survivors"]:
        survivor["note"] = notes.get((survivor["before"], survivor["after"]), "")
    results[state][file] = found
    RESULTS.write_text(json.dumps(results, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    show()


def kept() -> dict[str, dict[str, Any]]:
    """Return the stored results."""
    return json.loads(RESULTS.read_text(encoding="utf-8")) if RESULTS.exists() else {}


def show() -> None:
    """Write the counts into the page, and the list of survivors."""
    results = kept()
    write_block(PAGE, BLOCK, "\n".join([*table(results), ""]))
    LIST.write_text(survivors(results), encoding="utf-8")


def table(results: Results) -> list[str]:
    """Return the numbers of changes and survivors of each part, as Markdown."""
    heads = [f"{count}, {state}" for state in results for count in ("changes", "survive")]
    parts = dict.fromkeys(found["part"] for files in results.values() for found in files.values())
    lines = []
    for part in parts:
        cells = [part]
        for files in results.values():
            of_part = [found for found in files.values() if found["part"] == part]
            cells.append(str(sum(found["mutants"] for found in of_part)))
            cells.append(str(sum(len(found["survivors"]) for found in of_part)))
        lines.append(cells)
    return markdown(["part", *heads], lines)


def survivors(results: Results) -> str:
    """Return the list of survivors with their notes, as Markdown."""
    text = [
        "# Changes of the source that no test notices",
        "",
        "By `python -m benchmarks.mutants`.",
    ]
    for state, files in results.items():
        text += ["", f"## {state[0].upper()}{state[1:]}"]
        for file, found in files.items():
            text += ["", f"`{file}`: {len(found['survivors'])} of {found['mutants']}", ""]
            for one in found["survivors"]:
                change = f"`{one['before']}` → `{one['after']}`"
                text.append(f"- line {one['line']}: {change}: {one['note'] or 'not judged'}")
    return "\n".join(text) + "\n"
