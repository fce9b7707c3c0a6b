"""The printed answer of the reproduction."""

from collections.abc import Iterator

from flexid.models.flexible_joint import COEFFICIENT_UNITS
from flexid.report.terminal import Cell, Column, Part, Table, number, numbers
from flexid.studies.huang2003.evidence import Claim, Verdict
from flexid.studies.huang2003.readings import Reading
from flexid.studies.huang2003.reproduction import Reproduction
from flexid.studies.huang2003.table1 import ATTENUATION, TRUE, UNKNOWN
from flexid.studies.huang2003.theorem1 import TheoremCase

_COLOURS: dict[Verdict, str] = {
    "holds": "green",
    "does not hold": "red",
    "depends on the reading": "yellow",
}
_SHORT: dict[Verdict, str] = {
    "holds": "holds",
    "does not hold": "does not hold",
    "depends on the reading": "depends",
}


def reproduction_parts(result: Reproduction) -> Iterator[Part]:
    """Tables and sentences of the answer."""
    yield _readings(result)
    yield _parameter_errors(result)
    yield _cases(result.cases)
    yield _claims(result.claims)


def _readings(result: Reproduction) -> Table:
    columns = (
        Column("reading"),
        Column("", wraps=True),
        *numbers("rightmost pole (1/s)", "|x1 - qd| to 0.3 s (rad)", "20-30 s (rad)"),
    )
    title = f"Readings (a,b,c) of the gains k^a JlM/kem, k^b, k^c JrM, with k = {ATTENUATION:g}"
    table = Table(title, columns)
    for reading in result.readings.values():
        stable = reading.rightmost.real < 0
        table.add(
            f"({reading.name})",
            reading.meaning,
            Cell((_pole(reading.rightmost),), "green" if stable else "red"),
            number(reading.early_tracking_error, 4),
            _steady_error(reading),
        )
    return table


def _pole(pole: complex) -> str:
    return f"{pole.real:+.3g} ± {abs(pole.imag):.3g}j"


def _steady_error(reading: Reading) -> Cell | str:
    run = reading.simulated
    return number(run.max_tracking_error, 4) if run else "not simulated"


def _parameter_errors(result: Reproduction) -> Table:
    runs = result.runs
    headings = (text for name in runs for text in (f"({name})", "share"))
    table = Table("Parameter errors at 30 s", (Column("coefficient"), *numbers("true", *headings)))
    for name in UNKNOWN:
        cells: list[Cell] = []
        for run in runs.values():
            share = 100 * run.relative_errors[name]
            cells += [number(run.parameter_errors[name], 6), number(share, 2, "%")]
        table.add(f"{name} ({COEFFICIENT_UNITS[name]})", number(TRUE[name], 6), *cells)
    return table


def _cases(cases: tuple[TheoremCase, ...]) -> Table:
    columns = (
        Column("case"),
        Column("reference", wraps=True),
        Column("rows"),
        *numbers("condition number", "settled", "largest error left"),
    )
    table = Table("Theorem 1 in three cases, gains (1,2,3)", columns)
    for case in cases:
        left = max(abs(limit.last / limit.first) for limit in case.limits)
        table.add(
            case.name,
            f"{case.reference}, {case.duration:g} s",
            ", ".join(case.judged),
            number(case.worst_condition, 2),
            "yes" if case.settled else "no",
            number(100 * left, 3, "%"),
        )
    return table


def claim_verdicts(claims: tuple[Claim, ...]) -> Table:
    """Claims without what decides them."""
    table = Table("Claims of the paper", (Column("claim", wraps=True), Column("verdict")))
    for claim in claims:
        verdict = Cell((claim.verdict,), _COLOURS[claim.verdict])
        table.add(f"{claim.statement} [{claim.source}]", verdict)
    return table


def _claims(claims: tuple[Claim, ...]) -> Table:
    columns = (Column("claim, and what decides it", wraps=True), *numbers("value", "wanted"))
    table = Table("Claims of the paper", (*columns, Column("", right=True)))
    for claim in claims:
        verdict = Cell((_SHORT[claim.verdict],), _COLOURS[claim.verdict])
        table.add(f"{claim.statement} [{claim.source}]", "", "", verdict)
        for finding in claim.findings:
            relation = {"<=": "≤", ">=": "≥"}[finding.relation]
            subject = "" if finding.subject == "any" else f"{finding.subject}: "
            table.add(
                Cell((f"  {subject}{finding.quantity}",), "dim"),
                number(finding.value, 4, "" if finding.unit == "1" else finding.unit),
                f"{relation} {finding.limit:g}",
                Cell(("yes",), "green") if finding.holds else Cell(("no",), "red"),
            )
        if claim is not claims[-1]:
            table.rule()
    return table
