"""How a stream is shown: the last report, the view that is renewed, and its lines of bars."""

import numpy as np
import pytest

from flexid.report.terminal import laid_out
from flexid.report.watch import (
    Sparks,
    live_view,
    parts,
    sparkline,
)
from flexid.streaming.options import WatchOptions
from flexid.streaming.session import Session


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
