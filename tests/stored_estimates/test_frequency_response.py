"""Frequency response of an identified joint: closed forms, and coverage of its band."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

import flexid
import made_estimates
from flexid.identification.vocabulary.evidence import quantile
from flexid.models.flexible_joint import BACKLASH_WIDTH, BEND_DEFLECTION, SPRING_CENTRE
from flexid.report.figure import draw
from flexid.report.response_charts import bode_chart
from flexid.simulation.free_run import free_run
from flexid.stored_estimates.frequency_response import (
    frequency_response,
    linear_joint,
    response_band,
)

TRUE = {"theta1": 5.0, "theta2": 100.0, "theta_damping": 0.5}
TRUE |= {"alpha1": 400.0, "alpha2": 1.5, "alpha_damping": 2.0, "beta1": 4.0}
STEP = 1e-3
TERMS = ("gravity", "motor_viscous", "joint_damping")


@pytest.fixture(scope="module")
def log():
    """Return a torque with all frequencies from 0.05 to 20 Hz, and the joint's motion."""
    samples, generator = 20_000, np.random.default_rng(3)
    hertz = np.arange(1, 400) / (samples * STEP)
    time = STEP * np.arange(samples)
    waves = np.cos(2 * np.pi * np.outer(time, hertz) + generator.uniform(0, 6.28, len(hertz)))
    torque = 0.25 * waves.sum(axis=1)
    states = free_run(flexid.flexible_joint(TERMS), TRUE, np.zeros(4), torque, STEP, "zero")
    noise = 1e-4 * generator.standard_normal((samples, 2))
    link, motor = (states[:, ::2] + noise).T
    return {
        "time [s]": time,
        "link_position [rad]": link,
        "motor_position [rad]": motor,
        "motor_torque [N m]": torque,
    }


@pytest.fixture(scope="module")
def estimate(log):
    """Return the estimate of the log."""
    return flexid.identify(log, terms=TERMS, hold="zero", segment_duration=1.0)


def two_masses(c, omega):
    """Return velocities of motor and link per torque, by Cramer's rule."""
    s = 1j * omega
    spring = c["theta2"] + s * c["theta_damping"]
    coupled = c["alpha1"] + s * c["alpha_damping"]
    link = s**2 + c["theta1"] + spring
    motor = s**2 + s * c["alpha2"] + coupled
    determinant = link * motor - spring * coupled
    return s * c["beta1"] * link / determinant, s * c["beta1"] * spring / determinant


@pytest.mark.parametrize("position", [0.0, 2.0])
def test_it_is_that_of_the_two_mass_drive(estimate, position):
    """Assert both responses by closed forms, at any frequency and any position."""
    hertz = np.geomspace(0.01, 300, 50)
    found = estimate.frequency_response(frequency=hertz, position=position)
    values = {name: c.value for name, c in estimate.coefficients.items()}
    values["theta1"] *= np.cos(position)
    motor, link = two_masses(values, 2 * np.pi * hertz)
    by_output = {r.output: r for r in found.responses}
    np.testing.assert_allclose(by_output["motor velocity"].values, motor, rtol=1e-9)
    np.testing.assert_allclose(by_output["link velocity"].values, link, rtol=1e-9)
    assert by_output["link velocity"].unit == "rad/s/(N m)"
    assert repr(found) == (
        "<FrequencyResponse: link velocity, motor velocity; 50 frequencies, 0.01 to 300 Hz>"
    )


SHAPED = {
    "bent_spring": ("bend", {BEND_DEFLECTION: 0.02, SPRING_CENTRE: 0.0}),
    "backlash": ("backlash", {BACKLASH_WIDTH: 2e-3}),
}


@pytest.mark.parametrize("term", SHAPED)
def test_of_a_shaped_spring_it_is_that_without_the_shape(term):
    """Assert the stiffness below the bend of a bent spring, and that beyond the gap of play."""
    name, shapes = SHAPED[term]
    plain = made_estimates.TRUE
    made = made_estimates.exact(plain | {f"theta_{name}": 0.3, f"alpha_{name}": 1.0}, "")
    choices = replace(made.choices, terms=(*made.choices.terms, term), shapes=shapes)
    hertz = np.geomspace(0.1, 20, 20)
    undamped = {"theta_damping": 0.0, "alpha_damping": 0.0}
    motor, _ = two_masses(plain | undamped, 2 * np.pi * hertz)
    found = frequency_response(replace(made, choices=choices), frequency=hertz)
    np.testing.assert_allclose(found.responses[1].values, motor, rtol=1e-9)


def test_the_interval_of_a_resonance_follows_the_covariance(estimate):
    """Assert the resonance's standard error against draws of correlated coefficients."""
    joint = linear_joint(estimate.result)
    generator = np.random.default_rng(11)
    draws = joint.deviations @ generator.standard_normal((joint.deviations.shape[1], 4000))
    theta1, theta2, alpha1 = (
        joint.values[place] + draws[place]
        for place in map(joint.names.index, ("theta1", "theta2", "alpha1"))
    )
    total = theta1 + theta2 + alpha1
    resonance = np.sqrt((total + np.sqrt(total**2 - 4 * theta1 * alpha1)) / 2) / (2 * np.pi)
    (found,) = (f for f in frequency_response(estimate.result).characteristic if f.name[0] == "r")
    half = (found.interval[1] - found.interval[0]) / 2
    deviation = half / quantile(joint.degrees_of_freedom)
    assert deviation == pytest.approx(np.std(resonance), rel=0.06)  # 1.1 % scatter


LIGHT = {"theta1": 5.0, "theta2": 100.0, "alpha1": 333.0, "alpha2": 0.33, "beta1": 3.33}


@pytest.mark.parametrize(
    ("values", "spread", "seed"), [(LIGHT, 0.05, 1), (LIGHT, 0.005, 2), (TRUE, 0.05, 3)]
)
def test_the_band_covers(estimate, values, spread, seed):
    """Assert that 95 % bands cover about 95 % of correlated draws, also near peaks."""
    joint = linear_joint(estimate.result)
    full = np.array([values.get(name, 0.0) for name in joint.names])
    mixed = np.random.default_rng(seed).standard_normal((len(values), len(values)))
    mixed /= np.linalg.norm(mixed, axis=1)[:, None]
    deviations = np.zeros((len(full), len(values)))
    deviations[np.flatnonzero(full)] = mixed
    deviations *= spread * np.abs(full)[:, None]
    known = {"free": np.zeros(len(full), dtype=bool), "degrees_of_freedom": np.inf}
    true = replace(joint, values=full, deviations=deviations, **known)
    antiresonance = (values["theta1"] + values["theta2"]) ** 0.5
    resonance = (values["theta2"] + values["alpha1"]) ** 0.5
    beside = 1.0 + np.linspace(-0.04, 0.04, 4)
    omega = np.concatenate(
        (np.geomspace(0.3, 200.0, 8), antiresonance * beside, resonance * beside)
    )
    response = true.positions(omega)
    generator = np.random.default_rng(seed)
    inside = []
    for _ in range(250):
        moved = true.deviations @ generator.standard_normal(true.deviations.shape[1])
        found = replace(true, values=true.values + moved)
        lower, upper, behind, ahead = response_band(found, omega, 0.95)
        ratio = response / found.positions(omega)
        size, angle = np.abs(ratio), np.angle(ratio)
        held = (lower <= size) & (size <= upper)
        turned = (behind <= angle) & (angle <= ahead)
        inside.append((held, turned))
    shares = np.mean(inside, axis=0)
    assert shares.min() > 0.89  # of 250 draws; 0.95 minus four standard errors
    assert 0.92 < shares.mean() < 0.985


def test_what_is_not_determined_leaves_no_band(estimate):
    """Assert that an undetermined coefficient is named, in the figure too, without finite band."""
    lost = estimate.result.fit.without_knowledge_of({"theta2"})
    coefficients = estimate.result.coefficients
    found = frequency_response(replace(estimate.result, fit=lost))
    assert found.unknown == ("theta2", "theta_damping")  # tied to theta2
    assert np.isinf(found.responses[0].upper).all()
    assert found.characteristic[0].interval == (0.0, np.inf)
    titles = [panel.title for panel in bode_chart(found).panels]
    assert any("theta2, theta_damping not determined" in title for title in titles)
    assert coefficients["theta2"].verdict == "determined"


@pytest.mark.parametrize(
    ("name", "value", "still"),
    [("theta2", 0.0, set()), ("beta1", 0.0, {0, 1}), ("alpha1", np.nan, set())],
)
def test_a_joint_that_is_none_can_be_drawn(estimate, name, value, still):
    """Assert that zero or missing values of spring or gain still give a figure."""
    changed = replace(estimate.result.coefficients[name], value=value, slopes={})
    coefficients = {**estimate.result.coefficients, name: changed}
    found = frequency_response(replace(estimate.result, coefficients=coefficients))
    assert {i for i, r in enumerate(found.responses) if not r.values.any()} == still
    assert all(np.isinf(found.responses[i].upper).all() for i in still)
    assert (name in found.unknown) == np.isnan(value)
    assert draw(bode_chart(found))._repr_png_()  # type: ignore[attr-defined] - in a notebook


def test_nonsense_is_refused(estimate, refusals):
    """Assert that invalid options are refused with valid ones."""
    numbers = ([1.0, 0.0], [np.nan], [], "all")
    options = [{"frequency": f} for f in numbers] + [{"position": np.inf}, {"level": 95}]
    refusals({str(one): partial(estimate.frequency_response, **one) for one in options})


def test_link_and_rigid_joint_have_one_as_well(log, tmp_path):
    """Assert link over motor without a torque, and the rigid joint's response for one encoder."""
    del_torque = {name: values for name, values in log.items() if "torque" not in name}
    link = flexid.identify(del_torque, terms=("gravity", "joint_damping"), segment_duration=1.0)
    (response,) = link.frequency_response(frequency=np.array([0.001, 8.0])).responses
    c = {name: e.value for name, e in link.coefficients.items()}
    s = 2j * np.pi * 8.0
    spring = c["theta2"] + s * c["theta_damping"]
    assert (response.output, response.input) == ("link position", "motor position")
    assert response.values[1] == pytest.approx(spring / (s**2 + c["theta1"] + spring))
    assert [f.name for f in link.frequency_response().characteristic] == ["antiresonance"]
    examined = flexid.excitation(del_torque, terms=("gravity",), segment_duration=1.0)
    assert set(examined.coefficients) == {"theta1", "theta2"}
    one = {name: values for name, values in log.items() if "link" not in name}
    rigid = flexid.identify(one, terms=("viscous",), hold="zero", segment_duration=1.0)
    found = rigid.frequency_response(frequency=np.array([2.0]))
    beta, damping = (rigid.coefficients[name].value for name in ("beta1", "gamma_viscous"))
    assert found.responses[0].values[0] == pytest.approx(beta / (4j * np.pi + damping))
    assert found.characteristic == ()
    for one, columns in ((rigid, 1), (link, 1)):
        chart = bode_chart(one.frequency_response())
        assert chart.columns == columns
        assert draw(chart).axes
        one.report(tmp_path / "report.html")
        one.save(tmp_path / "estimate.json")
        loaded = flexid.load(tmp_path / "estimate.json")
        assert loaded.validate(log).fit_percent
        assert loaded.model == one.model
