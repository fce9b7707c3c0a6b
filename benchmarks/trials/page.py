"""Tables of scores for the terminal and for `docs/trials.md`."""

from collections.abc import Callable, Mapping, Sequence
from math import isfinite
from pathlib import Path
from textwrap import wrap
from typing import Any

from benchmarks.report import markdown
from benchmarks.trials import cells
from benchmarks.trials.families import FAMILIES
from benchmarks.trials.realistic import page as realistic
from benchmarks.trials.score import ANGLES, Claim, FamilyScore, Share, Spread, claims, scores

RESULTS = Path(__file__).parents[1] / "trials.json"
PAGE = Path(__file__).parents[2] / "docs" / "trials.md"

BLOCK = "trials"

WIDTH = 98  # characters of a line of text

Results = Mapping[str, Any]

Column = tuple[str, Callable[[FamilyScore], str]]


def render(results: Results) -> str:
    """Return all results as Markdown, failures first."""
    clean, with_sins = _kinds(results)
    found = scores(clean)
    parts = ["### How it was run", "", *_how(results), ""]
    if found:
        parts += ["### Scores", "", *wrap(_ABOUT, WIDTH), ""]
    for in_class, heading in ((True, "in the model class"), (False, "outside it")):
        chosen = [one for one in found if one.in_class is in_class]
        if chosen:
            headings = [heading, *(name for name, _ in _COLUMNS)]
            lines = [[one.family, *(cell(one) for _, cell in _COLUMNS)] for one in chosen]
            parts += [*markdown(headings, lines), ""]
    if found:
        parts += ["### Each log that is confidently wrong", "", *_wrong(clean), ""]
    if with_sins:
        parts += realistic.render(with_sins)
    parts += ["### Each log without a result", "", *_failed(results["records"]), ""]
    return "\n".join(parts)


def terminal(results: Results) -> str:
    """Return all scores for a terminal, without the lists of families."""
    clean, with_sins = _kinds(results)
    found = scores(clean)
    parts = []
    for title, columns in _TABLES if found else ():
        headings = [title, *(name for name, _ in columns)]
        lines = [[one.family, *(cell(one) for _, cell in columns)] for one in found]
        parts += [*_aligned(headings, lines), ""]
    if found:
        parts += _wrong(clean)
    if with_sins:
        parts += ["", *_aligned(*realistic.table(with_sins))]
    return "\n".join(parts)


def _kinds(results: Results) -> tuple[list[Mapping[str, Any]], list[Mapping[str, Any]]]:
    """Return the records of the usual families, and those of the realistic ones."""
    clean = [record for record in results["records"] if not record.get("realistic")]
    return clean, [record for record in results["records"] if record.get("realistic")]


def _aligned(headings: list[str], lines: list[list[str]]) -> list[str]:
    """Return a table for a terminal."""
    widths = [max(map(len, column)) for column in zip(headings, *lines, strict=True)]
    return [
        "  ".join(text.ljust(width) for text, width in zip(line, widths, strict=True)).rstrip()
        for line in (headings, *lines)
    ]


def families() -> str:
    """Return the list of families as Markdown."""
    outside = {True: "no, a term of its own", False: "no"}
    lines = [
        [one.name, one.about, "yes" if one.in_class else outside[one.own_term]]
        for one in FAMILIES.values()
    ]
    return "\n".join(markdown(["family", "properties", "in the model class"], lines))


def _percent(some: Share) -> str:
    return f"{some.percent:.1f}" if some.whole else "–"


def _coverage(one: FamilyScore) -> str:
    share = _percent(one.coverage["all"])
    deviation = one.coverage_deviation
    return f"{share}±{100.0 * deviation:.1f}" if isfinite(deviation) else share


def _spread(spread: Spread) -> str:
    values = (spread.middle, spread.high, spread.largest)
    if not all(isfinite(value) for value in values):
        return "–"
    return " / ".join(cells.percent(value) for value in values)


def _counts(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{name} {count}" for name, count in counts.items()) or "–"


_ABOUT = (
    "Confidently wrong: reported as determined, outside its 95 % interval, and off by more than "
    "1 %; logs with such a core parameter (gravity torque, inertias, stiffness), and with any. "
    "No result: in brackets those with an error message for the user. Intervals: percent of "
    "nominal 95 % intervals that contain the truth, of all with the standard error between logs, "
    "and of the determined core. Error of the determined core in percent: median, 90th percentile "
    "and largest. Seconds of processor time: median and largest."
)

_COLUMNS: Sequence[Column] = (
    ("logs", lambda one: str(one.logs)),
    ("wrong, core", lambda one: str(one.wrong_core)),
    ("any", lambda one: str(one.wrong)),
    ("no result", lambda one: cells.failures(one.failed, one.refused)),
    ("core determined", lambda one: _percent(one.core_determined)),
    ("intervals, all", lambda one: _coverage(one)),
    ("core", lambda one: _percent(one.coverage["core"])),
    ("error", lambda one: _spread(one.error).replace(" ", "")),
    ("seconds", lambda one: cells.seconds(one.seconds).replace(" ", "")),
)

_TABLES: tuple[tuple[str, Sequence[Column]], ...] = (
    (
        "Failures",
        (
            ("logs", lambda one: str(one.logs)),
            ("confidently wrong, core", lambda one: str(one.wrong_core)),
            ("confidently wrong, any", lambda one: str(one.wrong)),
            ("no result", lambda one: cells.failures(one.failed, one.refused)),
            ("core determined", lambda one: cells.share(one.core_determined)),
        ),
    ),
    (
        "Intervals",
        (
            ("all", lambda one: _coverage(one)),
            ("determined", lambda one: cells.share(one.coverage["determined"])),
            ("determined core", lambda one: cells.share(one.coverage["core"])),
            ("removed", lambda one: cells.share(one.coverage["removed"])),
            ("delays", lambda one: cells.share(one.coverage["delay"])),
            ("width", lambda one: cells.number(one.sharpness)),
        ),
    ),
    (
        "Errors and times",
        (
            ("error", lambda one: _spread(one.error)),
            ("given", lambda one: _spread(one.given_error)),
            ("least squares, given", lambda one: _spread(one.least_squares_error)),
            ("seconds", lambda one: cells.seconds(one.seconds)),
        ),
    ),
    (
        "Choices",
        (
            ("missed", lambda one: _counts(one.missed)),
            ("extra", lambda one: _counts(one.extra)),
            ("wrong hold", lambda one: str(one.wrong_hold)),
        ),
    ),
)


def _how(results: Results) -> list[str]:
    lines = []
    for kind, records in zip(("", "realistic "), _kinds(results), strict=True):
        if records:
            seeds = [record["seed"] for record in records]
            seen = f"Seeds {min(seeds)} to {max(seeds)} of each {kind}family, {len(seeds)} logs."
            lines += [seen, ""]
    for about in results["runs"]:
        minutes = about.get("seconds", 0) / 60.0
        made = (
            f"`{about['command']}`, {about['date']}, commit {about['commit']}, "
            f"{about['machine']}, Python {about['python']}: {minutes:.0f} min."
        )
        lines += wrap(made, WIDTH, initial_indent="- ", subsequent_indent="  ")
    return lines


def _wrong(records: Sequence[Mapping[str, Any]]) -> list[str]:
    lines = [
        [record["family"], str(record["seed"]), *_wrong_cells(record, claim)]
        for record in records
        if "error" not in record
        for claim in claims(record)
        if claim.confidently_wrong
    ]
    if not lines:
        return ["None."]
    headings = ["family", "seed", "parameter", "truth", "value", "interval", "off", "given, off"]
    return markdown(headings, lines)


def _wrong_cells(record: Mapping[str, Any], claim: Claim) -> list[str]:
    given = record.get("given", {}).get(claim.name)
    error_if_given = "–"
    if isinstance(given, list):
        error_if_given = _off(Claim("kept", claim.name, *given[:3], status="", truth=claim.truth))
    return [
        claim.name,
        f"{claim.truth:.5g}",
        f"{claim.value:.5g}",
        f"{claim.low:.5g} to {claim.high:.5g}",
        _off(claim),
        error_if_given,
    ]


def _off(claim: Claim) -> str:
    if claim.name in ANGLES:
        return f"{claim.value - claim.truth:+.2g} rad"
    return f"{100.0 * (claim.value - claim.truth) / abs(claim.truth):+.2g} %"


def _failed(records: Sequence[Mapping[str, Any]]) -> list[str]:
    failed = [record for record in records if "error" in record]
    if not failed:
        return ["None."]
    lines = [[r["family"], str(r["seed"]), r["error"].replace("|", "\\|")] for r in failed]
    return markdown(["family", "seed", "error"], lines)
