"""Scores as tables: on the terminal, and on `docs/trials.md`."""

from collections.abc import Callable, Mapping, Sequence
from math import isfinite
from pathlib import Path
from typing import Any

from benchmarks.report import markdown
from benchmarks.trials import cells
from benchmarks.trials.families import FAMILIES
from benchmarks.trials.realistic import page as realistic
from benchmarks.trials.score import ANGLES, Claim, FamilyScore, Spread, claims, scores

RESULTS = Path(__file__).parents[1] / "trials.json"
PAGE = Path(__file__).parents[2] / "docs" / "trials.md"

BLOCK = "trials"

Results = Mapping[str, Any]

Column = tuple[str, Callable[[FamilyScore], str]]


def render(results: Results) -> str:
    """Everything that was measured, as Markdown; failures first."""
    clean, with_sins = _kinds(results)
    found = scores(clean)
    parts = ["### How it was run", "", *_how(results), ""]
    for title, about, columns in _TABLES if found else ():
        parts += [f"### {title}", "", about, ""]
        for in_class, heading in ((True, "in the model class"), (False, "outside it")):
            chosen = [one for one in found if one.in_class is in_class]
            if chosen:
                headings = [heading, *(name for name, _ in columns)]
                lines = [[one.family, *(cell(one) for _, cell in columns)] for one in chosen]
                parts += [*markdown(headings, lines), ""]
    if found:
        parts += ["### Each log that is confidently wrong", "", *_wrong(clean), ""]
    if with_sins:
        parts += realistic.render(with_sins)
    parts += ["### Each log without a result", "", *_failed(results["records"]), ""]
    return "\n".join(parts)


def terminal(results: Results) -> str:
    """The tables without the lists of families, for a terminal."""
    clean, with_sins = _kinds(results)
    found = scores(clean)
    parts = []
    for title, _, columns in _TABLES if found else ():
        headings = [title, *(name for name, _ in columns)]
        lines = [[one.family, *(cell(one) for _, cell in columns)] for one in found]
        parts += [*_aligned(headings, lines), ""]
    if found:
        parts += _wrong(clean)
    if with_sins:
        parts += ["", *_aligned(*realistic.table(with_sins))]
    return "\n".join(parts)


def _kinds(results: Results) -> tuple[list[Mapping[str, Any]], list[Mapping[str, Any]]]:
    """Records of the usual families, and of the realistic ones."""
    clean = [record for record in results["records"] if not record.get("realistic")]
    return clean, [record for record in results["records"] if record.get("realistic")]


def _aligned(headings: list[str], lines: list[list[str]]) -> list[str]:
    """A table for a terminal."""
    widths = [max(map(len, column)) for column in zip(headings, *lines, strict=True)]
    return [
        "  ".join(text.ljust(width) for text, width in zip(line, widths, strict=True)).rstrip()
        for line in (headings, *lines)
    ]


def families() -> str:
    """The families as Markdown."""
    outside = {True: "no, a term of its own", False: "no"}
    lines = [
        [one.name, one.about, "yes" if one.in_class else outside[one.own_term]]
        for one in FAMILIES.values()
    ]
    return "\n".join(markdown(["family", "what it has", "in the model class"], lines))


def _coverage(one: FamilyScore) -> str:
    share = one.coverage["all"]
    if not isfinite(one.coverage_deviation):
        return cells.share(share)
    return f"{share.percent:.1f} ± {100.0 * one.coverage_deviation:.1f} % of {share.whole}"


def _spread(spread: Spread) -> str:
    values = (spread.middle, spread.high, spread.largest)
    if not all(isfinite(value) for value in values):
        return "–"
    return " / ".join(cells.percent(value) for value in values)


def _counts(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{name} {count}" for name, count in counts.items()) or "–"


_TABLES: tuple[tuple[str, str, Sequence[Column]], ...] = (
    (
        "Failures",
        "Confidently wrong: said to be determined, outside its 95 % interval, and off by more "
        "than 1 %; logs with such a parameter out of gravity torque, inertias and stiffness "
        "(core), or out of all. No result: in brackets those with an error made for the user.",
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
        "Nominal 95 % intervals that hold the truth; of all, delays among them, with the standard "
        "error from log to log. Removed: parameters of terms that were taken "
        "out of the model. Width: of the determined core parameters, over the width with terms, "
        "hold and delays given; median.",
        (
            ("all", _coverage),
            ("determined", lambda one: cells.share(one.coverage["determined"])),
            ("determined core", lambda one: cells.share(one.coverage["core"])),
            ("removed", lambda one: cells.share(one.coverage["removed"])),
            ("delays", lambda one: cells.share(one.coverage["delay"])),
            ("width", lambda one: cells.number(one.sharpness)),
        ),
    ),
    (
        "Errors and times",
        "Relative errors of the determined core parameters in percent: median / 90th percentile / "
        "largest; beside them those of the same parameters with terms, hold and delays given, and "
        "those of filtered least squares given the same. "
        "Seconds of processor time for one log: median / largest.",
        (
            ("error", lambda one: _spread(one.error)),
            ("given", lambda one: _spread(one.given_error)),
            ("least squares, given", lambda one: _spread(one.least_squares_error)),
            ("seconds", lambda one: cells.seconds(one.seconds)),
        ),
    ),
    (
        "Choices",
        "Terms that act and were not chosen, terms that were chosen and do not act, and holds that "
        "were mistaken, with the number of logs.",
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
        lines.append(
            f"- `{about['command']}`, {about['date']}, commit {about['commit']}, "
            f"{about['machine']}, Python {about['python']}: {minutes:.0f} min."
        )
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
    beside = "–"
    if isinstance(given, list):
        beside = _off(Claim("kept", claim.name, *given[:3], status="", truth=claim.truth))
    return [
        claim.name,
        f"{claim.truth:.5g}",
        f"{claim.value:.5g}",
        f"{claim.low:.5g} to {claim.high:.5g}",
        _off(claim),
        beside,
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
