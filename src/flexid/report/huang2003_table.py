"""The printed answer of the reproduction, at most 100 columns wide."""

from collections.abc import Iterator

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from flexid.models.flexible_joint import COEFFICIENT_UNITS
from flexid.report.terminal import print_parts, titled_table
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


def print_reproduction(result: Reproduction) -> None:
    """Print readings, parameter errors, the cases of Theorem 1 and the claims."""
    print_parts(_parts(result))


def _parts(result: Reproduction) -> Iterator[RenderableType]:
    yield _readings(result)
    yield _parameter_errors(result)
    yield _cases(result.cases)
    yield _claims(result.claims)


def _table(title: str, texts: tuple[str, ...], numbers: tuple[str, ...]) -> Table:
    """Table with columns of text, then columns of numbers."""
    table = titled_table(title)
    for heading in texts:
        table.add_column(heading)
    for heading in numbers:
        table.add_column(heading, justify="right", no_wrap=True)
    return table


def _readings(result: Reproduction) -> Table:
    table = _table(
        f"Readings (a,b,c) of the gains k^a JlM/kem, k^b, k^c JrM, with k = {ATTENUATION:g}",
        ("reading", ""),
        ("rightmost pole", "|x1 - qd| to 0.3 s", "20-30 s"),
    )
    for reading in result.readings.values():
        stable = reading.rightmost.real < 0
        table.add_row(
            f"({reading.name})",
            reading.meaning,
            Text(f"{_pole(reading.rightmost)} 1/s", "green" if stable else "red"),
            f"{reading.early_tracking_error:.4g} rad",
            _steady_error(reading),
        )
    return table


def _pole(pole: complex) -> str:
    return f"{pole.real:+.3g} ± {abs(pole.imag):.3g}j"


def _steady_error(reading: Reading) -> str:
    run = reading.simulated
    return f"{run.max_tracking_error:.4g} rad" if run else "not simulated"


def _parameter_errors(result: Reproduction) -> Table:
    runs = result.runs
    headings = tuple(text for name in runs for text in (f"({name})", "share"))
    table = _table("Parameter errors at 30 s", ("coefficient",), ("true", *headings))
    for name in UNKNOWN:
        cells: list[str] = []
        for run in runs.values():
            share = 100 * run.relative_errors[name]
            cells += [f"{run.parameter_errors[name]:+.6g}", f"{share:.2g} %"]
        table.add_row(f"{name} ({COEFFICIENT_UNITS[name]})", f"{TRUE[name]:.6g}", *cells)
    return table


def _cases(cases: tuple[TheoremCase, ...]) -> Table:
    table = _table(
        "Theorem 1 in three cases, gains (1,2,3)",
        ("case", "reference", "rows"),
        ("condition number", "settled", "largest error left"),
    )
    for case in cases:
        left = max(abs(limit.last / limit.first) for limit in case.limits)
        table.add_row(
            case.name,
            f"{case.reference}, {case.duration:g} s",
            ", ".join(case.judged),
            f"{case.worst_condition:.2g}",
            "yes" if case.settled else "no",
            f"{100 * left:.3g} %",
        )
    return table


def _claims(claims: tuple[Claim, ...]) -> Table:
    table = _table("Claims of the paper", ("claim, and what decides it",), ("value", "wanted", ""))
    for claim in claims:
        verdict = Text(_SHORT[claim.verdict], _COLOURS[claim.verdict])
        table.add_row(Text(f"{claim.statement} [{claim.source}]"), "", "", verdict)
        for place, finding in enumerate(claim.findings, start=1):
            unit = "" if finding.unit == "1" else f" {finding.unit}"
            relation = {"<=": "≤", ">=": "≥"}[finding.relation]
            subject = "" if finding.subject == "any" else f"{finding.subject}: "
            table.add_row(
                Text(f"  {subject}{finding.quantity}", "dim"),
                f"{finding.value:.4g}{unit}",
                f"{relation} {finding.limit:g}",
                Text("yes", "green") if finding.holds else Text("no", "red"),
                end_section=place == len(claim.findings),
            )
    return table
