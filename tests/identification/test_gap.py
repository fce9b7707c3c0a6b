"""Play of the joint, whose shape is as wide as its own gap: on made logs with a sharp dead zone."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from made_joint import COEFFICIENTS, log, made
from scipy.integrate import quad

from flexid.estimators.channel_timing import Timing
from flexid.identification.full_model.fitting import fit_to
from flexid.identification.full_model.model import Fitted, Structure, data_of
from flexid.identification.identify import identify
from flexid.identification.preparation.joint import flexible
from flexid.identification.preparation.settings import Settings
from flexid.identification.structure.gap import as_wide_as_its_gap, half_gap
from flexid.models.flexible_joint import BACKLASH_WIDTH, PAPER_TERMS, WIDTH_OF_GAP
from flexid.recording.velocities import with_velocities

HALF_GAP = 4e-4  # rad


@cache
def fitted(half_gap: float, *terms: str) -> Fitted:
    """The paper's model with some more terms, fitted to ten seconds of a drive with a gap."""
    recording = with_velocities(made(1, 10.0, half_gap=half_gap))
    joint = flexible()
    data = data_of(joint, [recording], (0,))
    joint = joint.scaled(data.samples)
    on = {c for term in (*PAPER_TERMS, *terms) for c in joint.terms[term]}
    structure = Structure(joint, frozenset(joint.optional - on), Timing("cubic"))
    return fit_to(structure, data, COEFFICIENTS, 1.0)[0]


def width(found: Fitted) -> float:
    """Width of its shape, in rad."""
    return found.structure.joint.extended.constants[BACKLASH_WIDTH]


def test_both_shapes_lack_the_same_of_a_sharp_step():
    """Assert that the width makes the areas equal between each shape and a step."""
    of_gap, _ = quad(lambda d: 1.0 - d, 0.0, 1.0)
    of_shape, _ = quad(lambda d: 1.0 - np.tanh(d / WIDTH_OF_GAP), 0.0, 30.0)
    assert of_shape == pytest.approx(of_gap, rel=1e-6)


@pytest.mark.parametrize("true_gap", [HALF_GAP, 1.5e-3])
def test_a_gap_is_found_as_wide_as_it_is(true_gap):
    """Assert that a gap comes out within 0.3 %, and its spring; by the first width it did not."""
    first = fitted(true_gap, "backlash")
    found = as_wide_as_its_gap(first)
    assert abs(half_gap(first) / true_gap - 1.0) > 0.01
    assert half_gap(found) == pytest.approx(true_gap, rel=3e-3)
    assert found.by_name["theta2"] == pytest.approx(COEFFICIENTS["theta2"], rel=3e-4)
    assert width(found) == pytest.approx(WIDTH_OF_GAP * half_gap(found), rel=0.1)
    assert found.excess < first.excess


def test_what_has_no_gap_stays():
    """Assert that a fit without play, or whose gap came out negative, is returned as it is."""
    assert as_wide_as_its_gap(fitted(HALF_GAP)) is fitted(HALF_GAP)
    found = fitted(HALF_GAP, "backlash")
    values = found.values.copy()
    values[found.names.index("alpha_backlash")] *= -1.0
    point = replace(found.minimum.point, values=values)
    negative = replace(found, minimum=replace(found.minimum, point=point))
    assert as_wide_as_its_gap(negative) is negative


def test_a_width_that_fits_worse_is_not_taken():
    """Assert that a spring that bends, and has no gap, keeps the width that its shape had."""
    found = fitted(0.0, "backlash")
    recording = with_velocities(made(1, 10.0, bend=0.1, bend_stiffness=30.0))
    data = data_of(flexible(), [recording], (0,))
    bent, _ = fit_to(found.structure, data, COEFFICIENTS, 1.0)
    assert half_gap(bent) > 0.0
    assert abs(WIDTH_OF_GAP * half_gap(bent) / width(bent) - 1.0) > 0.5
    assert as_wide_as_its_gap(bent) is bent


def test_two_logs_of_one_gap():
    """Assert that two logs give one gap, and that how the torque runs is asked again with it.

    Without the gap no hold explains them, and a torque on straight lines fits best by chance.
    """
    logs = [
        log(made(seed, duration, half_gap=HALF_GAP)) for seed, duration in ((1, 10.0), (2, 8.0))
    ]
    found = identify(logs)
    assert found.choices.terms == (*PAPER_TERMS, "backlash")
    assert found.choices.hold == "cubic"
    assert found.parameters["half_backlash"].value == pytest.approx(HALF_GAP, rel=3e-3)
    assert max(found.residual_excess.values()) < 1.05


def test_the_link_alone_has_a_gap():
    """Assert that a gap is found without the motor's row, over segments of any length."""
    found = identify([log(made(1, 10.0, half_gap=2e-3))], Settings(model="link"))
    gap = found.parameters["half_backlash"]
    assert gap.value == pytest.approx(2e-3, rel=0.01)
    assert found.choices.shapes["backlash_width"] == pytest.approx(WIDTH_OF_GAP * 2e-3, rel=0.1)
