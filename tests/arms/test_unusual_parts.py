"""What an arm may have beyond the usual, and what one pass over its log promises of that."""

from __future__ import annotations

from test_disturbed_arm import CURVED, STRUCTURE, moved

from flexid.arms.fitting import begun
from flexid.arms.log import arm_data
from flexid.arms.unusual import FittedArm, promises, unusual_parts
from flexid.estimators.channel_timing import INPUT
from flexid.estimators.segments import divide
from flexid.identification.full_model.fitting import Steps, fit_segments


def fitted_without() -> FittedArm:
    """A fit of straight springs to an arm whose first one hardens."""
    data = arm_data([moved(CURVED)])
    segments = divide(data.samples, 0.4)
    start = begun(STRUCTURE, data, segments).by_name
    return fit_segments(STRUCTURE, data, segments, start, None, Steps(0.1))


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
