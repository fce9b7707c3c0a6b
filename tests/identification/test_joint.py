"""Terms of the two joints, and what each leaves to be sought."""

from dataclasses import replace

import numpy as np
import pytest

from flexid.estimators.samples import Samples
from flexid.identification.preparation.joint import flexible, rigid
from flexid.models.flexible_joint import BACKLASH_WIDTH

FLEXIBLE = flexible()


@pytest.mark.parametrize("joint", [FLEXIBLE, rigid()], ids=["flexible", "rigid"])
def test_terms_and_what_is_always_there_make_the_system(joint):
    """Assert that each coefficient belongs to one term, or to the spring and the input's gain."""
    of_terms = [c for names in joint.terms.values() for c in names]
    always = ["theta2", "alpha1", "beta1"] if joint.kind == "flexible" else ["beta1"]
    assert sorted([*of_terms, *always]) == sorted(joint.remembering.coefficients)


@pytest.mark.parametrize("term", ["joint_damping", "cubic_stiffness", "backlash", "eccentricity"])
def test_what_the_spring_does_to_both_sides_is_one_number(term):
    """Assert that the link's side of the spring follows from the motor's by the inertias' ratio.

    Jr/Jl = theta2/alpha1 = 0.3 here, so 2 on the motor's side are 0.6 on the link's.
    """
    found = FLEXIBLE.unknowns(FLEXIBLE.optional - {*FLEXIBLE.terms[term]}, {}, groups=(0,))
    known = {"theta2": 90.0, "alpha1": 300.0, "beta1": 1.0}
    values = [known.get(name, 2.0) for name in found.names]
    link = [c for c in FLEXIBLE.terms[term] if c.startswith("theta")]
    assert not {*link} & {*found.names}
    every = dict(zip(found.system.coefficients, found.coefficients(values, 0), strict=True))
    assert [every[c] for c in link] == pytest.approx([0.6] * len(link))


def moving(size: float) -> Samples:
    """A motion of this size with a deflection a tenth of it."""
    time = 0.01 * np.arange(1000)
    motor, twist = size * np.sin(time), 0.1 * size * np.sin(3.0 * time)
    speeds = np.column_stack((size * np.cos(time) + 0.3 * size * np.cos(3.0 * time),) * 2)
    speeds[:, 1] = size * np.cos(time)
    return Samples(np.column_stack((motor + twist, motor)), speeds, np.zeros((1000, 1)), 0.01)


def test_shapes_scale_with_the_motion():
    """Assert that twice the motion makes every width twice as wide, and needs no other kernel."""
    one, two = (FLEXIBLE.scaled([moving(size)]) for size in (1.0, 2.0))
    assert one.first["hysteresis_grip"] == pytest.approx(2.0 * two.first["hysteresis_grip"])
    width, smoothing = (
        [getattr(joint, system).constants[name] for joint in (one, two)]
        for system, name in (("extended", BACKLASH_WIDTH), ("smooth", "coulomb_velocity"))
    )
    assert 0.0 < 2.0 * width[0] == pytest.approx(width[1])
    assert 2.0 * smoothing[0] == pytest.approx(smoothing[1])
    assert two.extended.digest == FLEXIBLE.extended.digest
    samples = moving(1.0)
    assert samples.velocities is not None
    motor = replace(
        samples, positions=samples.positions[:, 1:], velocities=samples.velocities[:, 1:]
    )
    rigid_smoothing = rigid().scaled([motor]).smooth.constants["coulomb_velocity"]
    assert rigid_smoothing == pytest.approx(0.1 / 2**0.5, rel=0.05)


def test_given_smoothing_takes_the_place_of_dry_friction():
    """Assert that with a Coulomb velocity friction is smooth in every system, without shapes."""
    joint = FLEXIBLE.with_coulomb_velocity(0.01)
    assert joint.system is joint.extended is joint.smooth
    assert joint.system.constants["coulomb_velocity"] == 0.01
    assert joint.system.digest == FLEXIBLE.smooth.digest
    assert not joint.shapes
