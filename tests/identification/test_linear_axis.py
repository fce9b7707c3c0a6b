"""Linear axes: prismatic joints in m, N and kg, with the model and names of revolute joints."""

import numpy as np
import pytest

import flexid
from flexid.errors import FlexidError
from flexid.models.flexible_joint import flexible_joint
from flexid.models.physical import joint_coefficients
from flexid.simulation.free_run import free_run

TRUTH = {
    "link_inertia": (12.0, "kg"),
    "motor_inertia": (5.0, "kg"),
    "joint_stiffness": (2e5, "N/m"),
    "motor_viscous_friction": (60.0, "N s/m"),
    "joint_damping": (30.0, "N s/m"),
    "link_offset_torque": (-20.0, "N"),
}
"""A table driven by a belt on a slope."""

TERMS = ("motor_viscous", "joint_damping", "link_offset")
STEP = 1e-3  # s
NOISE = 2e-7  # m


def recorded(seed=1, duration=3.0):
    """Return time, positions and force of the axis: a sum of tones, white noise on the encoders."""
    rng, time = np.random.default_rng(seed), STEP * np.arange(round(duration / STEP))
    tones = 2.0 * np.pi * np.geomspace(0.7, 50.0, 9)
    force = 40.0 * np.sin(time[:, None] * tones + rng.uniform(0.0, 6.0, 9)).sum(axis=1)
    values = {name: value for name, (value, _) in TRUTH.items()}
    run = free_run(
        flexible_joint(TERMS), joint_coefficients(values), np.zeros(4), force[:, None], STEP, "zero"
    )
    noise = NOISE * rng.standard_normal((len(time), 2))
    return time, *(run[:, ::2] + noise).T, force


def log_of(position="m", force="N", factor=1.0, **more):
    """Return a log with positions in this unit."""
    time, link, motor, drive = recorded(**more)
    return {
        "time [s]": time,
        f"link_position [{position}]": factor * link,
        f"motor_position [{position}]": factor * motor,
        f"motor_torque [{force}]": drive,
    }


@pytest.fixture(scope="module")
def axis():
    """Return the estimate of the log in m and N."""
    return flexid.identify(log_of())


def test_an_axis_is_found_in_its_own_units(axis):
    """Assert that terms and true values of the axis are found from its log alone."""
    assert axis.joint == "prismatic"
    assert axis.parameters.keys() == TRUTH.keys()
    for name, (value, unit) in TRUTH.items():
        assert axis.parameters[name].unit == unit
        assert abs(axis.parameters[name].value - value) <= 2.0 * axis.parameters[name].half_width
        assert axis.parameters[name].verdict == "determined"
    assert axis.coefficients["beta1"].unit == "m/s^2/N"
    text = axis.summary(explain=True)
    assert not any(unit in text for unit in ("rad ", "rad,", "N m ", "kg m^2", "gravity"))


@pytest.mark.parametrize("factor", [1e-4, 1e4])
def test_no_length_is_built_in(axis, factor):
    """Assert that a scale of 10⁴ changes the estimate by its scale only."""
    other = flexid.identify(log_of(factor=factor))
    assert other.terms == axis.terms
    for name, p in axis.parameters.items():
        expected = p.value / (1.0 if p.unit == "N" else factor)
        half = 0.3 * p.half_width * expected / p.value
        assert other.parameters[name].value == pytest.approx(expected, abs=half)


def test_what_turns_is_refused():
    """Assert that logs of a revolute and a prismatic joint cannot be combined."""
    with pytest.raises(FlexidError, match=r"of a revolute joint, and .* a prismatic joint"):
        flexid.identify([log_of(), log_of("rad", "N m", seed=2)])


def test_it_comes_back_from_a_file(axis, tmp_path):
    """Assert that a stored estimate stays prismatic, and validates prismatic logs only."""
    loaded = flexid.load(axis.save(tmp_path / "estimate.json") or tmp_path / "estimate.json")
    assert loaded.joint == "prismatic"
    assert "prismatic flexible" in repr(loaded)
    validation = loaded.validate(log_of(seed=2))
    assert min(validation.fit_percent.values()) > 95.0
    assert "(m, RMS)" in validation.summary()
    with pytest.raises(
        FlexidError, match=r"of a revolute joint, and in estimate that of a prismatic"
    ):
        loaded.validate(log_of("rad", "N m", seed=2))
    responses = loaded.frequency_response().responses
    assert {(r.input, r.unit) for r in responses} == {("force", "m/s/N")}


def test_a_stream_of_it_learns_in_its_units():
    """Assert that a stream uses linear units if its column map declares a prismatic joint."""
    _, link, motor, force = recorded(duration=6.0)
    watch = flexid.watch(sample_time=STEP, columns={"joint": "prismatic"}, filter_rate=100.0)
    watch.feed(link_position=link, motor_position=motor, motor_torque=force)
    assert watch.parameters["motor_inertia"].unit == "kg"
    assert watch.parameters["link_inertia"].value == pytest.approx(12.0, rel=0.05)
    assert "gravity_torque" not in watch.parameters
    gravity = flexid.watch(sample_time=STEP, columns={"joint": "prismatic"}, terms=("gravity",))
    with pytest.raises(FlexidError, match="no term of the prismatic flexible joint; it has motor_"):
        gravity.feed(link_position=link, motor_position=motor, motor_torque=force)
