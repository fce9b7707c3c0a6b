"""Drive files, and a designed experiment for Table I's joint: errors, limits, predictions."""

import json
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from matplotlib.figure import Figure
from scipy.optimize import brentq

import flexid as flexid_library
from flexid.estimators.prediction_error import prediction_error
from flexid.estimators.samples import Samples
from flexid.estimators.state_variable_filter import filtered_least_squares
from flexid.experiment_design.design import design, deviation, predict, smooth_cost, waveform
from flexid.experiment_design.drive import Case, CaseRun, read_drive
from flexid.models.flexible_joint import flexible_joint
from flexid.models.physical import joint_coefficients
from flexid.report.design import write_data
from flexid.simulation.free_run import free_run
from flexid.stored_estimates.estimate_file import read_estimate, sealed
from flexid.studies.runs import PHYSICAL
from joint_logs import SAMPLE_TIME, steady_sine
from made_estimates import stored_document, stored_value

DRIVE = Path(__file__).parents[2] / "examples" / "drive.toml"
TEXT = DRIVE.read_text()


def test_values_of_a_drive(here):
    """Assert Table I's, a known value in every perturbed drive, and an encoder's step as noise."""
    drive = read_drive(DRIVE).drive
    assert drive.coefficients == pytest.approx(joint_coefficients(PHYSICAL))
    assert set(drive.nominal.coefficients) == set(drive.coefficients)
    path = here / "drive.toml"
    path.write_text('known = ["motor_inertia"]\n' + TEXT)
    drive = read_drive(path).drive
    assert "beta1" not in drive.nominal.coefficients
    assert {case.system.constants["beta1"] for case in drive.cases(0)} == {1 / 0.3}
    path.write_text(TEXT.replace("position_noise = 1e-4", "encoder_bits = 12"))
    drive = read_drive(path).drive
    assert drive.sensors.noise == pytest.approx(2 * np.pi / 4096 / np.sqrt(12))


@pytest.fixture
def stored(tmp_path):
    """Write the estimate of Table I's joint with some parameters changed; return its path."""

    def write(terms=("gravity", "motor_viscous"), **changed):
        document = stored_document({}, {"joint_stiffness": 100.0, "link_inertia": 1.0})
        for name, changes in changed.items():
            document["parameters"][name] = stored_value(100.0, name=name) | changes
        document["choices"]["terms"] = terms
        path = tmp_path / "estimate.json"
        path.write_text(json.dumps(sealed(document)))
        return path

    return write


def test_an_estimate_replaces_beliefs(stored):
    """Assert values by name, and warnings of shapes, guesses and values that are missing."""
    path = stored(link_inertia={"value": 1.5}, joint_damping={"value": 0.1})
    file = read_drive(DRIVE, read_estimate(path))
    assert file.drive.values == pytest.approx({**PHYSICAL, "link_inertia": 1.5})
    assert [name for name, _ in file.inputs] == ["drive.toml", "estimate.json"]
    (warning,) = file.warnings
    assert "joint_damping" in warning
    undetermined = {"verdict": "undetermined"}
    path = stored(
        ("gravity", "motor_stribeck"),
        link_inertia={"value": None, **undetermined},
        joint_stiffness={"value": 90.0, **undetermined},
        motor_inertia={"value": PHYSICAL["motor_inertia"], **undetermined},
    )
    file = read_drive(DRIVE, read_estimate(path))
    assert file.drive.values == pytest.approx({**PHYSICAL, "joint_stiffness": 90.0})
    shape, nothing, guessed = file.warnings
    assert "motor_stribeck" in shape
    assert "gravity" not in shape
    assert "link_inertia has no finite value" in nothing
    assert "joint_stiffness, motor_inertia is undetermined" in guessed


OTHERWISE = {  # text in the example, and its replacement
    "a slide": ("[parameters]", 'joint = "prismatic"\n[parameters]'),
    **{
        f"a torque of {t}": ("torque = 30.0", f"torque = {t}")
        for t in ("nan", "inf", "-1.0", '"30"')
    },
    "a misspelt limit": ("torque = 30.0", "torqe = 30.0"),
    "no inertia": ("link_inertia = 1.0", "link_inertia = 0.0"),
    "an inertia missing": ("link_inertia = 1.0", ""),
    "no gravity": ("gravity_torque = 5.0", "gravity_torque = 0.0"),
    "a negative spring": ("= 100.0", "= -100.0"),
    "a negative duration": ("duration = 10.0", "duration = -10.0"),
    "an endless duration": ("duration = 10.0", "duration = 1e9"),
    "long samples": ("sample_time = 0.001", "sample_time = 0.05"),
    "many harmonics": ("sample_time = 0.001", "sample_time = 0.001\nharmonics = 1000"),
    "a long ramp": ("sample_time = 0.001", "sample_time = 0.001\nramp = 6.0"),
    "no noise": ("position_noise = 1e-4", ""),
    "noise twice": ("position_noise = 1e-4", "position_noise = 1e-4\nencoder_bits = 12"),
    "a misspelt table": ("[sensors]", "[sensor]"),
}


def test_what_no_drive_is(stored, refusals, here):
    """Assert that file and key are named, for a drive as for its estimate."""
    path = Path("drive.toml")

    def read(old="", new="", estimate=None):
        assert old in TEXT
        path.write_text(TEXT.replace(old, new) if old else TEXT)
        return read_drive(path, estimate and read_estimate(estimate))

    alone = json.loads(stored().read_text())
    held = alone["parameters"].pop("joint_stiffness")
    alone["parameters"] = {"joint_stiffness_per_link_inertia": held}
    calls = {name: partial(read, *pair) for name, pair in OTHERWISE.items()}
    calls["an estimate of a link alone"] = partial(read, estimate=sealed(alone))
    stored(joint_stiffness={"value": -100.0})
    calls["an estimate's spring"] = partial(read, estimate="estimate.json")
    refusals(calls)


SEEDS = 40


@pytest.fixture(scope="module")
def designed():
    """Return the design of a short experiment with few tones for the example drive."""
    file = read_drive(DRIVE)
    short = {"duration": 4.0, "sample_time": 0.002, "harmonics": 6}
    experiment = file.drive.experiment.model_copy(update=short)
    quick = replace(file, drive=file.drive.model_copy(update={"experiment": experiment}))
    return design(quick, 0, lambda _: None)


def test_beats_the_papers_motion_within_its_limits(designed):
    """Assert smaller errors than the paper's sine at equal torque, and limits on wrong drives."""
    peak, duration = designed.prediction.peaks["torque"], designed.drive.experiment.duration

    def too_much(amplitude):
        return np.abs(steady_sine(amplitude, 5.0, duration)[0]).max() - peak

    torque, start = steady_sine(brentq(too_much, 0.05, 3.0), 5.0, duration)
    case = designed.drive.nominal
    states = free_run(case.system, case.coefficients, start, torque, SAMPLE_TIME, "zero")
    run = CaseRun(states, torque, SAMPLE_TIME)
    other = predict(designed.drive, case, run)
    assert designed.prediction.worst < other.worst
    assert designed.prediction.e_deviation < other.e_deviation
    uses = [extreme.value for extreme in designed.largest_use.values()]
    assert max(uses) <= 1.0
    assert max(uses) > 0.9


def test_errors_of_a_fit_are_as_predicted(designed, tmp_path):
    """Assert that fits to noisy runs of the designed input have the predicted errors."""
    write_data(designed, tmp_path)
    table = pl.read_csv(tmp_path / "command.csv")
    torque = table["motor_torque [N m]"].to_numpy()
    case, drive = designed.drive.nominal, designed.drive
    np.testing.assert_allclose(torque, designed.run.torque, atol=1e-8 * np.abs(torque).max())
    generator = np.random.default_rng(7)
    errors = []
    for _ in range(SEEDS):
        noise = drive.sensors.noise * generator.standard_normal((len(torque), 2))
        positions = designed.run.states[:, ::2] + noise
        samples = Samples(positions, None, torque[:, None], drive.experiment.sample_time)
        start = filtered_least_squares([samples], case.system, 20.0, "zero")
        fit = prediction_error([samples], case.system, start, 1.0, "zero")
        errors.append(fit.values / case.values - 1.0)
    scatter = np.sqrt(np.mean(np.square(errors), axis=0))
    predicted = np.array([designed.prediction.deviations[name] for name in case.coefficients])
    # The root mean square of 40 draws has a standard error of 11 %.
    np.testing.assert_allclose(scatter / predicted, 1.0, atol=0.4)


@pytest.fixture
def _one_start(monkeypatch):
    """Let a search begin once, for tests of a command."""
    monkeypatch.setattr("flexid.experiment_design.design.STARTS", 1)


@pytest.mark.usefixtures("_one_start")
def test_command_writes_what_it_promises(flexid, tiny_drive, tmp_path):
    """Assert files of the command, which depend on the seed, and the library's same design."""
    outcome = flexid("design", tiny_drive, "--out", tmp_path)
    assert outcome.status == 0, outcome.stderr
    assert max(map(len, outcome.stdout.splitlines())) <= 80
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {"command.csv", "design.json", "design.png", "report.html"}
    document = json.loads((tmp_path / "design.json").read_text())
    assert document["provenance"]["inputs"][0]["file"] == "drive.toml"
    header = (tmp_path / "command.csv").read_text().splitlines()[0]
    assert header == "time [s],motor_torque [N m]"
    steps: list[str] = []
    found = flexid_library.design(tiny_drive, progress=steps.append)
    assert found.document == document
    assert steps
    assert isinstance(found.plot(), Figure)
    assert found._page().title == "The designed torque"
    assert max(found.deviations.values()) == found.result.prediction.worst
    assert repr(found).startswith("<ExperimentDesign: 2 s, worst coefficient")
    other = flexid("design", tiny_drive, "--json", "--seed", 4).stdout
    assert json.loads(other)["tones"] != document["tones"]


@pytest.mark.usefixtures("_one_start")
def test_designs_that_fail(flexid, tiny_drive, tmp_path):
    """Assert status 2 if limits allow no motion, and 1 if a coefficient stays undetermined."""
    offset = "motor_viscous_friction = 0.1\nmotor_offset_torque = 4.9"
    text = tiny_drive.read_text().replace("motor_viscous_friction = 0.1", offset)
    path = tmp_path / "offset.toml"
    path.write_text(text.replace("position = 60.0", "position = 0.01"))
    outcome = flexid("design", path)
    assert outcome.status == 2
    assert "limits.position" in outcome.stderr
    assert len(outcome.stderr.strip().splitlines()) == 1
    text = tiny_drive.read_text().replace("position_noise = 1e-4", "position_noise = 0.3")
    path = tmp_path / "noisy.toml"
    path.write_text(text)
    assert flexid("design", path, "--json").status == 1


@pytest.mark.parametrize("offset", [0.0, 1.0])
def test_a_drive_rests_where_its_model_does(offset):
    """Assert that a drive at rest stays at rest, for any angle of gravity and constant torques."""
    offsets = "link_offset", "motor_offset"
    joint = flexible_joint(("gravity", "gravity_cosine", "motor_viscous", *offsets))
    values = {"theta1": 5.0, "theta_cosine": 2.0, "theta2": 100.0, "alpha1": 300.0, "alpha2": 0.3}
    values |= {"beta1": 3.3, "theta_offset": 1.3 * offset, "alpha_offset": -2.0 * offset}
    case = Case("tilted", joint, {name: values[name] for name in joint.coefficients})
    motion = free_run(joint, case.coefficients, case.rest(), np.zeros(1001), 1e-3)
    assert np.abs(motion - case.rest()).max() < 1e-8
    assert abs(case.rest()[0]) > 0.1


TONES = waveform(duration=5.0, sample_time=1e-3, ramp=0.5, highest_frequency=30.0, harmonics=6)
WEIGHTS = np.random.default_rng(1).standard_normal(12)


def test_tones_are_whole_periods_between_rests():
    """Assert rest at both ends, and different tones of whole periods up to the highest."""
    signal = TONES.signal(WEIGHTS)
    for values, none in ((signal, 1e-12), (np.diff(signal), 1e-3)):
        assert np.abs(values[[0, -1]]).max() < none * np.abs(values).max()
    periods = TONES.angular_frequencies * 5.0 / (2 * np.pi)
    np.testing.assert_allclose(periods, np.rint(periods), atol=1e-9)
    assert len(np.unique(np.rint(periods))) == 6
    assert TONES.angular_frequencies[-1] == pytest.approx(30.0, abs=2 * np.pi / 5.0)


INFORMATION = np.diag([4.0, 100.0, 1e4])


def test_the_criterion_is_the_worst_direction():
    """Assert one over the root of the smallest eigenvalue, and a finite cost for the search."""
    turn, _ = np.linalg.qr(np.random.default_rng(0).standard_normal((3, 3)))
    assert deviation(turn @ INFORMATION @ turn.T) == pytest.approx(0.5)
    assert smooth_cost(INFORMATION) == pytest.approx(np.log(0.5), abs=0.01)
    singular = np.diag([1.0, 0.0])
    assert np.isinf(deviation(singular))
    assert np.isfinite(smooth_cost(singular))
