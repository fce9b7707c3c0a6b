"""What a log tells of errors of its rig: eccentric encoders, scales and lengths."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from test_disturbed_arm import disturbed, recording
from two_links import ARM

from flexid.arms.disturbed import DisturbedFit, Job
from flexid.arms.doubts import likely_changes, rig_errors
from flexid.arms.log import arm_data
from flexid.arrays import FloatArray
from flexid.errors import ConvergenceError
from flexid.identification.preparation.joint import ElasticArm
from flexid.models.planar_arm import planar_arm


def refitted(job: Job) -> DisturbedFit:
    """The fit of the log, from its values on, with another log or other lengths."""
    made = disturbed()
    near = job.in_band.with_gains_of(made.fitted, made.fitted.by_name, 3)
    return replace(made, job=job, best=replace(made.best, fitted=near))


def told_of(found: DisturbedFit) -> FloatArray:
    """Change of each value by the errors that the log tells of, over its standard deviation."""
    rigs = [*rig_errors(found.fitted, found.job.deflections)]
    return likely_changes(found.fitted, rigs)[:, -1] / disturbed().estimate.deviations


def shown(row: int, error: FloatArray, relative_to: dict[str, str]) -> DisturbedFit:
    """The fit of a log one of whose positions has an error."""
    positions = recording().positions.copy()
    positions[:, row] += error
    data = arm_data([replace(recording(), positions=positions)], relative_to)
    return refitted(replace(disturbed().job, data=data))


def longer() -> DisturbedFit:
    """The fit with a first link that is said to be 2 % too long."""
    job = disturbed().job
    arm = replace(ARM, lengths=(1.02 * ARM.lengths[0], *ARM.lengths[1:]))
    structure = replace(job.structure, joint=ElasticArm(planar_arm(arm)))
    return refitted(replace(job, structure=structure))


@pytest.mark.parametrize("error", ["eccentric", "motor's scale", "deflection's scale", "length"])
def test_a_log_tells_of_an_error_of_its_rig(error: str):
    """Assert that what the log tells undoes most of what a gross error has done to the values."""
    link, motor = recording().positions.T[:2]
    wrong = {
        "eccentric": lambda: shown(0, 2e-3 * np.sin(link), {}),
        "motor's scale": lambda: shown(1, 0.01 * motor, {}),
        "deflection's scale": lambda: shown(0, 0.1 * (link - motor), {"link_1": "motor_1"}),
        "length": longer,
    }[error]()
    done = (wrong.fitted.values - disturbed().fitted.values) / disturbed().estimate.deviations
    without = told_of(replace(wrong, best=disturbed().best, job=disturbed().job))
    left = np.linalg.norm(done + told_of(wrong) - without)
    assert np.linalg.norm(done) > 1.0
    assert left < 0.5 * np.linalg.norm(done)


def test_a_rig_on_which_the_motion_diverges_says_nothing():
    """Assert that no value that is no number gets into an interval."""
    fitted = disturbed().fitted
    segments = fitted.problem.segments
    far = replace(segments, outputs=segments.outputs + 1e200)
    with pytest.raises(ConvergenceError, match="diverges"):
        likely_changes(fitted, [replace(fitted.problem, segments=far)])


def test_a_right_rig_is_hardly_doubted():
    """Assert that where nothing is wrong what is doubted stays within what is uncertain anyway."""
    found = disturbed()
    rigs = [*rig_errors(found.fitted, ())]
    assert len(rigs) == 7  # of two joints: sine and cosine, a scale; and one length
    sizes = np.linalg.norm(likely_changes(found.fitted, rigs), axis=1)
    assert np.median(sizes / found.estimate.deviations) < 1.0
