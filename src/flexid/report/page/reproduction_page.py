"""The page of the reproduced paper: which of its claims hold, and what decides that."""

from __future__ import annotations

from collections.abc import Sequence

from rich.text import Text

import flexid
from flexid.report.charts.description import Chart
from flexid.report.huang2003_table import claim_verdicts, reproduction_parts
from flexid.report.page.layout import Answer, Command, Facts, Page, Section
from flexid.studies.huang2003.readings import TOLERANCE
from flexid.studies.huang2003.reproduction import Reproduction
from flexid.studies.huang2003.table1 import DURATION

_PAPER = (
    "J. T. Huang, A New Approach to Parametric Identification of a Single-Link Flexible-Joint "
    "Manipulator, Journal of Intelligent and Robotic Systems 37 (2003) 273–284"
)


def reproduction_page(result: Reproduction, charts: Sequence[Chart]) -> Page:
    """What there is to say of the paper."""
    facts = Facts(
        [
            ("flexid", flexid.__version__),
            ("duration of a run", f"{DURATION:g} s"),
            ("integrator", f"Rodas5P, relative tolerance {TOLERANCE:g}"),
        ]
    )
    return Page(
        "reproduction",
        "Huang (2003), reproduced",
        _PAPER,
        claim_verdicts(result.claims),
        (_holds(result), _readings(result)),
        (
            Section("figures", "Its figures, and Theorem 1", charts),
            Section("numbers", "The numbers behind each verdict", [*reproduction_parts(result)]),
            Section("origin", "How to repeat it", [Command("flexid reproduce"), facts]),
        ),
    )


def _holds(result: Reproduction) -> Answer:
    verdicts = [claim.verdict for claim in result.claims]
    hold, depend = verdicts.count("holds"), verdicts.count("depends on the reading")
    content = [
        Text(f"{depend} more depend on how the printed gains are read."),
        Text(f"{len(verdicts) - hold - depend} do not hold."),
    ]
    word = f"{hold} of {len(verdicts)}"
    return Answer("Do its claims hold?", word, "good" if hold == len(verdicts) else "fair", content)


def _readings(result: Reproduction) -> Answer:
    """Which readings of the gains keep the loop stable."""
    stable = [f"({r.name})" for r in result.readings.values() if r.rightmost.real < 0.0]
    said = Text(
        f"As powers (a,b,c) of k; of {len(result.readings)} readings only these keep the closed "
        f"loop stable."
    )
    return Answer("How are its gains to be read?", ", ".join(stable) or "None", "", [said])
