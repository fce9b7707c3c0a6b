"""How a stream is shown: the last report, the view that is renewed, and its lines of bars."""

from dataclasses import replace

import numpy as np
import pytest

from flexid.identification.vocabulary.evidence import ParameterEstimate, Verdict
from flexid.report.terminal import laid_out
from flexid.report.watch import (
    Sparks,
    live_view,
    parts,
    sparkline,
)
from flexid.streaming.guard import Counts
from flexid.streaming.options import WatchOptions
from flexid.streaming.session import Session

NONE = Counts(*[0] * 12)


@pytest.fixture(scope="module")
def session() -> Session:
    """A session that has seen a drive at rest."""
    session = Session(WatchOptions(2e-3, ("gravity", "motor_viscous"), hold="linear"))
    samples = np.zeros((1500, 4))
    samples[:, 0] = 2e-3 * np.arange(1500)
    session.feed(samples)
    return session


def test_the_report_begins_with_the_health(session: Session):
    """Assert that health, reason, parameters and samples are printed, within the width."""
    lines = [line.plain for line in laid_out(parts(session), 80)]
    assert lines[0].startswith("not excited: the motion so far does not separate")
    assert any(line.startswith("joint_stiffness") for line in lines)
    assert lines[-1] == "Samples: 1500 of 1500 learnt from"
    assert max(map(len, lines)) <= 80


def parameter(name: str, low: float, high: float, verdict: Verdict) -> ParameterEstimate:
    """One in the middle of its interval."""
    return ParameterEstimate(name, "", 0.5 * (low + high), 0.1, (low, high), verdict, "")


def test_a_friction_that_is_not_there_is_negligible(monkeypatch: pytest.MonkeyPatch):
    """Assert that the report says so in a line below the table."""
    session = Session(WatchOptions(2e-3, ("motor_coulomb",), hold="linear"))
    small = {"motor_coulomb_friction": parameter("motor_coulomb_friction", -1.0, 2.0, "determined")}
    monkeypatch.setattr(Session, "parameters", property(lambda _: small))
    lines = [line.plain for line in laid_out(parts(session), 120)]
    assert any(
        line.startswith("Negligible even at the ends of the interval: motor_coulomb")
        for line in lines
    )


def test_the_view_has_a_line_of_bars(session: Session):
    """Assert that the view says that nothing has come yet, and then shows what was known lately."""
    sparks = Sparks()
    assert "waiting" in live_view(None, sparks, 100).plain
    live_view(session, sparks, 100)
    view = live_view(session, sparks, 100).plain
    assert view.startswith("flexid watch, 2.998 s")
    assert "lately" in view


def test_bars():
    """Assert that bars are as high as their values, and that what is no number has none."""
    assert sparkline([1.0, float("nan"), 3.0]) == "▁ █"
    assert sparkline([2.0, 2.0]) == "▁▁"
    assert sparkline([-1e308, 1e308]) == "▁▁"
    assert sparkline([]) == ""


def test_what_became_of_the_samples():
    """Assert that only what happened is said."""
    counts = Counts(90, 1, 2, 0, 3, 0, 4, 1, 5, 2, 0, 0)
    assert NONE.sentence == "Samples: 0 of 0 learnt from"
    assert counts.sentence == (
        "Samples: 90 of 100 learnt from; 1 without a number, 2 repeated, 3 outliers, "
        "4 at the input's limit, 5 missing; 1 gap, 2 turns"
    )
    unclear = replace(NONE, unclear=2).sentence
    assert "At 2 places it cannot be known by how many turns the motor's encoder moved" in unclear
    assert "At 1 place it" in replace(NONE, unclear=1).sentence
