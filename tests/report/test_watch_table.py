"""How a stream is shown: the last report, the view that is renewed, and its lines of bars."""

import numpy as np
import pytest

from flexid.report.terminal import laid_out
from flexid.report.watch_table import Sparks, live_view, samples_sentence, sparkline, watch_parts
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
    lines = [line.plain for line in laid_out(watch_parts(session), 80)]
    assert lines[0].startswith("not excited: the motion so far does not tell")
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


def test_what_became_of_the_samples():
    """Assert that only what happened is said."""
    counts = Counts(90, 1, 2, 0, 3, 0, 4, 1, 5, 2, 0, 0)
    assert samples_sentence(NONE) == "Samples: 0 of 0 learnt from"
    assert samples_sentence(counts) == (
        "Samples: 90 of 100 learnt from; 1 without a number, 2 repeated, 3 outliers, "
        "4 at the input's limit, 5 missing; 1 gap, 2 turns"
    )
