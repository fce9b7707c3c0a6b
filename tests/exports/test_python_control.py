"""Systems for python-control: against closed forms, and against flexid's own runs."""

# python-control declares what it calls inputs and initial states as single numbers.
# pyright: reportArgumentType=false

import sys
from dataclasses import replace

import control
import numpy as np
import pytest

import flexid
from flexid.control.laws import robust_law
from flexid.control.references import Multisine
from flexid.errors import ModelError, SettingError
from flexid.library.python_control import observer_start, signal
from flexid.simulation.closed_loop import ClosedLoop, simulate
from flexid.simulation.free_run import free_run
from flexid.studies.readings import TRUE as TABLE_1
from joint_logs import DAMPED as TRUE

PRECISE = {"rtol": 1e-9, "atol": 1e-11, "method": "LSODA"}

EXPERIMENT = """
[model]
terms = ["gravity", "motor_viscous"]
known = ["beta1"]
[plant]
gravity_torque = 5.0
link_inertia = 1.0
joint_stiffness = 100.0
motor_inertia = 0.3
motor_viscous_friction = 0.1
[controller]
law = "pd-gravity"
proportional = 50.0
derivative = 10.0
[controller.nominal]
gravity_torque = 4.5
joint_stiffness = 75.0
[reference]
kind = "multisine"
amplitudes = [0.6, 0.3]
angular_frequencies = [2.0, 5.0]
[observer]
link = 5.0
motor = 5.0
[initial_estimates]
theta1 = 2.5
theta2 = 50.0
[run]
duration = 1.5
sample_time = 0.01
stiff = false
relative_tolerance = 1e-9
"""


@pytest.fixture(scope="module")
def drive():
    """The joint of the paper, with all coefficients sought."""
    return flexid.flexible_joint(("gravity", "motor_viscous", "joint_damping"))


@pytest.fixture(scope="module")
def experiment(tmp_path_factory):
    """A continuous closed loop that is not stiff."""
    path = tmp_path_factory.mktemp("loop") / "loop.toml"
    path.write_text(EXPERIMENT)
    return path


def test_linearised_it_is_the_two_mass_drive(drive):
    """Assert that the transfer functions of the linearised plant are the closed form."""
    plant = flexid.plant_io_system(drive, TRUE)
    linear = control.linearize(plant, np.zeros(4), 0.0)
    omega = np.geomspace(0.1, 300.0, 40)
    s = 1j * omega
    spring = TRUE["theta2"] + s * TRUE["theta_damping"]
    coupled = TRUE["alpha1"] + s * TRUE["alpha_damping"]
    link = s**2 + TRUE["theta1"] + spring
    determinant = link * (s**2 + s * TRUE["alpha2"] + coupled) - spring * coupled
    found = linear(s)[:, 0]
    # python-control differentiates with steps of 1e-6.
    np.testing.assert_allclose(found[2], TRUE["beta1"] * link / determinant, rtol=1e-4)
    np.testing.assert_allclose(found[0], TRUE["beta1"] * spring / determinant, rtol=1e-4)


def test_it_moves_as_the_free_run_does(drive):
    """Assert that the plant follows a torque on straight lines as flexid's own integrator does."""
    time = np.arange(501) * 1e-3
    torque = 8 * np.sin(3 * time) + 4 * np.sin(17 * time)
    plant = flexid.plant_io_system(drive, TRUE)
    start = np.array([0.3, 0.0, 0.2, 0.0])
    moved = control.input_output_response(plant, time, torque, start, solve_ivp_kwargs=PRECISE)
    own = free_run(drive, TRUE, start, torque, 1e-3, "linear")
    np.testing.assert_allclose(moved.outputs.T, own, atol=1e-6)
    softer = control.input_output_response(
        plant, time, torque, start, params={"theta2": 50.0}, solve_ivp_kwargs=PRECISE
    )
    own = free_run(drive, TRUE | {"theta2": 50.0}, start, torque, 1e-3, "linear")
    np.testing.assert_allclose(softer.outputs.T, own, atol=1e-6)


def test_a_closed_loop_is_that_of_simulate(experiment):
    """Assert that reference, law, plant and observer, interconnected, do what simulate says."""
    run = flexid.simulate(experiment).result
    loop = flexid.loop_io_system(experiment)
    moved = control.input_output_response(
        loop.system, run.time, 0.0, loop.start, solve_ivp_kwargs=PRECISE
    )
    by_name = dict(zip(moved.output_labels, moved.outputs, strict=True))
    np.testing.assert_allclose(moved.outputs[:4].T, run.states, atol=1e-5)
    np.testing.assert_allclose(by_name["u"], run.inputs[:, 0], atol=1e-3)
    np.testing.assert_allclose(by_name["theta1_hat"], run.estimates[:, 0], atol=1e-3)
    assert by_name["theta2_hat"][0] == pytest.approx(50.0)
    np.testing.assert_allclose(by_name["qd"], run.states[:, 0] - run.tracking_error, atol=1e-12)
    again = flexid.loop_io_system(flexid.simulate(experiment))
    np.testing.assert_array_equal(again.start, loop.start)


def test_a_law_says_what_it_says_in_the_loop():
    """Assert that the robust law gives the inputs of a run from its states and reference."""
    system = flexid.flexible_joint(known={"beta1": 1 / 0.3})
    law = robust_law(k=5.0)
    block = flexid.controller_io_system(law, system)
    assert block.input_labels[4:] == ["qd", "qd_1", "qd_2", "qd_3", "qd_4"]
    reference = Multisine([0.5], [2.0])
    true = {c: TABLE_1[c] for c in system.coefficients}
    gains = {"link": 1.0, "motor": 1.0}
    run = simulate(ClosedLoop(system, true, law, reference, gains), 1.0, 0.1)
    source = signal(reference, block.input_labels[4:])
    asked = [
        np.append(x, source.output(t, [], [])) for t, x in zip(run.time, run.states, strict=True)
    ]
    found = [block.output(0.0, [], signals) for signals in asked]
    np.testing.assert_allclose(found, run.inputs, rtol=1e-7, atol=1e-7)
    # Another gain changes what follows from it.
    with_other = block.output(0.0, [], asked[3], params={"k": 6.0})
    direct = flexid.controller_io_system(robust_law(k=6.0), system).output(0.0, [], asked[3])
    np.testing.assert_allclose(with_other, direct, rtol=1e-12)


def test_an_observer_starts_where_it_is_told(drive):
    """Assert that its first estimates are those asked for, from any state."""
    gains = {"link": 2.0, "motor": 3.0}
    paper = flexid.flexible_joint(known={"beta1": 4.0})
    block = flexid.observer_io_system(paper, gains)
    state = np.array([0.4, 1.2, 0.3, -2.0])
    start = observer_start(paper, gains, {"theta2": 70.0}, state)
    found = block.output(0.0, start, np.append(state, 1.0))
    np.testing.assert_allclose(found, [0.0, 70.0, 0.0, 0.0], atol=1e-9)


@pytest.mark.parametrize("build", ["recursive_least_squares", "parametric_observer"])
def test_an_online_estimator_steps_as_its_replay(build, examples):
    """Assert that its outputs in discrete time are the estimates before each sample."""
    system = flexid.flexible_joint(("gravity", "motor_viscous"))
    (samples,) = flexid.samples(examples / "flexible_joint.csv")
    if build == "parametric_observer":
        velocities = np.gradient(samples.positions, samples.sample_time, axis=0)
        samples = replace(samples, velocities=velocities)
        online = flexid.parametric_observer(system, {"link": 1.0, "motor": 1.0}, 1e-3)
    else:
        online = flexid.recursive_least_squares(system, 1e-3)
    packed = online.pack(samples)[:1500]
    block = flexid.estimator_io_system(online)
    assert block.dt == 1e-3
    assert block.ninputs == packed.shape[1]
    time = 1e-3 * np.arange(len(packed))
    moved = control.input_output_response(block, time, packed.T, online.init())
    replayed = online.replay(online.init(), packed).coefficients
    np.testing.assert_array_equal(moved.outputs.T[1:], replayed[:-1])
    assert replayed[-1].any()


def test_an_estimate_is_a_plant(example_estimate, tmp_path):
    """Assert that an estimate, or its file, gives a plant with the values that were found."""
    estimate = example_estimate
    estimate.save(tmp_path / "estimate.json")
    for what in (estimate, tmp_path / "estimate.json"):
        plant = flexid.plant_io_system(what, name="arm")
        values = {name: c.value for name, c in estimate.coefficients.items()}
        assert plant.name == "arm"
        assert plant.params == pytest.approx(values)
    described = estimate.frequency_response(frequency=[3.0])
    linear = control.linearize(plant, np.zeros(4), 0.0)
    motor = described.responses[1].values[0]
    assert linear(6j * np.pi)[3, 0] == pytest.approx(motor, rel=1e-3)


def test_what_is_missing_is_said(drive, monkeypatch):
    """Assert that a missing value, an unknown name and a missing package are sentences."""
    with pytest.raises(SettingError, match="theta_damping, alpha_damping missing"):
        flexid.plant_io_system(drive, {n: v for n, v in TRUE.items() if "damping" not in n})
    with pytest.raises(SettingError, match="'teta1' is unknown"):
        flexid.plant_io_system(drive, TRUE | {"teta1": 1.0})
    with pytest.raises(SettingError, match="motor missing"):
        flexid.observer_io_system(flexid.flexible_joint(known={"beta1": 4.0}), {"link": 1.0})
    with pytest.raises(flexid.ArgumentError, match="recursive_least_squares"):
        flexid.estimator_io_system(drive)
    saturating = flexid.flexible_joint(("gravity", "torque_saturation"), known={"beta1": 4.0})
    with pytest.raises(ModelError, match="rate of an input"):
        flexid.observer_io_system(saturating, {"link": 1.0, "motor": 1.0})
    monkeypatch.setitem(sys.modules, "control", None)
    with pytest.raises(SettingError, match=r"pip install 'flexid\[control\]'"):
        flexid.plant_io_system(drive, TRUE)
