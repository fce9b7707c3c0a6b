"""Where the fit of an arm begins; what it may have beyond the usual, and what that promises."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from test_disturbed_arm import CURVED, STRUCTURE, moved

import flexid.arms.fitting as fitting
from flexid.arms.fitting import FittedArm, begun, promises, unusual_parts
from flexid.arms.log import arm_data
from flexid.errors import ConvergenceError
from flexid.estimators.channel_timing import INPUT
from flexid.estimators.samples import Samples
from flexid.estimators.segments import divide
from flexid.identification.full_model.fitting import Steps, fit_segments


def test_each_start_is_tried_over_few_segments_first(monkeypatch: pytest.MonkeyPatch):
    """Assert that a start that diverges there is left out, and the next leads from there to all."""
    still = Samples(np.zeros((1000, 4)), None, np.zeros((1000, 2)), 2e-3)
    segments, asked = divide([still], 0.02), []

    def fit_segments(structure: Any, data: Any, segments: Any, start: Any, *_: Any) -> Any:
        asked.append((len(segments), start["number"]))
        if start["number"] == 1:
            raise ConvergenceError("prediction error", "diverges")
        return SimpleNamespace(by_name={"number": 10 * start["number"]})

    monkeypatch.setattr(fitting, "starts", lambda *_: [{"number": n} for n in (1, 2, 3)])
    monkeypatch.setattr(fitting, "by_misfit", lambda *given: given[3])
    monkeypatch.setattr(fitting, "fit_segments", fit_segments)
    likely, fit = fitting.begun(STRUCTURE, arm_data([still]), segments)
    assert likely == ({"number": 2}, {"number": 3})
    assert fit is not None
    assert fit.by_name == {"number": 200}
    few = asked[0][0]
    assert few < len(segments)
    assert asked == [(few, 1), (few, 2), (len(segments), 20)]


def fitted_without() -> FittedArm:
    """A fit of straight springs to an arm whose first one hardens."""
    data = arm_data([moved(CURVED)])
    segments = divide(data.samples, 0.4)
    _, first = begun(STRUCTURE, data, segments)
    assert first is not None
    return fit_segments(STRUCTURE, data, segments, first.by_name, None, Steps(0.1))


def test_a_step_promises_what_a_fit_brings():
    """Assert that the part that is there promises the most, and about what its fit brings."""
    fitted = fitted_without()
    squares = fitted.minimum.equations.cost
    parts = unusual_parts(STRUCTURE)
    promised = {part.name: cost for cost, part in promises(fitted, parts)}
    assert {"cubic_joint_stiffness_2", INPUT, "link_1_delay"} < promised.keys()
    assert min(promised, key=lambda name: promised[name]) == "cubic_joint_stiffness_1"
    structure = parts[0].added(STRUCTURE)
    states = fitted.minimum.point.initial_states
    found = fit_segments(
        structure, fitted.data, fitted.problem.segments, fitted.by_name, states, Steps(0.1)
    )
    brought = squares - found.minimum.equations.cost
    assert brought > 0.1 * squares
    assert abs(squares - promised["cubic_joint_stiffness_1"] - brought) < 0.2 * brought
