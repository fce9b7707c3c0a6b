"""Experiment files: their meaning, and refusals."""

import pickle
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flexid.experiments.experiment import Experiment, read_experiment
from flexid.simulation.closed_loop import simulate
from flexid.simulation.sampled import Sampling
from flexid.studies.runs import table1_loop

FOLDER = Path(__file__).parents[2] / "experiments"
TEXT = (FOLDER / "huang2003.toml").read_text(encoding="utf-8")
SAMPLED = (FOLDER / "sampled_joint.toml").read_text(encoding="utf-8")

PENDULUM = Path(__file__).with_name("pendulum_loop.toml").read_text(encoding="utf-8")


def write(folder: Path, text: str | bytes) -> Path:
    """Write an experiment file."""
    path = folder / "experiment.toml"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


@pytest.fixture
def pendulum(tmp_path: Path, examples: Path) -> Path:
    """Return an experiment with its own model and control law."""
    model = (examples / "models" / "pendulum.toml").read_text(encoding="utf-8")
    (tmp_path / "pendulum.toml").write_text(model, encoding="utf-8")
    return write(tmp_path, PENDULUM)


def test_table_1_is_the_studies_loop():
    """Assert that the shipped file gives the loop of Table I, with the same bits."""
    experiment = read_experiment(FOLDER / "huang2003.toml")
    loop = table1_loop((1, 2, 3))
    assert experiment.loop.parameters.tolist() == loop.parameters.tolist()
    assert experiment.loop.start_estimates.tolist() == loop.start_estimates.tolist()
    assert experiment.loop.initial_state == loop.initial_state
    assert (experiment.mode, experiment.settings.duration, experiment.settings.sample_time) == (
        "continuous",
        30.0,
        1e-3,
    )
    short = experiment.with_values({"run.duration": 1.0})
    mine, theirs = short.run(), simulate(loop, 1.0, 1e-3, 1e-6)
    assert np.array_equal(mine.states, theirs.states)
    assert np.array_equal(mine.parameter_errors, theirs.parameter_errors)


def test_campaign_starts_from_table_1():
    """Assert that the shipped campaign varies the loop of Table I and nothing else."""
    campaign = read_experiment(FOLDER / "huang2003_campaign.toml")
    assert campaign.loop.parameters.tolist() == table1_loop((1, 2, 3)).parameters.tolist()
    assert campaign.digest == read_experiment(FOLDER / "huang2003.toml").digest


def test_model_file_lies_beside_the_experiment(pendulum: Path):
    """Assert that a model's path is relative to the experiment, and that its constants are kept."""
    experiment = read_experiment(pendulum)
    assert experiment.loop.system.constants == {"inertia": 0.05}
    assert experiment.values["plant.inertia"] == 0.05
    run = experiment.run()
    assert abs(run.tracking_error[-1]) < abs(run.tracking_error[0])


def test_experiment_travels_to_other_processes(pendulum: Path):
    """Assert that a pickled experiment can be varied without its model file."""
    sent = pickle.dumps(read_experiment(pendulum))
    (pendulum.parent / "pendulum.toml").unlink()
    arrived = pickle.loads(sent).with_values({"controller.parameters.stiffness": 3.0})
    assert arrived.loop.controller.parameters == {"stiffness": 3.0}


def test_byte_order_mark_does_not_count(tmp_path: Path):
    """Assert that a UTF-8 byte-order mark is ignored."""
    marked = read_experiment(write(tmp_path, b"\xef\xbb\xbf" + TEXT.encode()))
    assert marked.digest == read_experiment(FOLDER / "huang2003.toml").digest


def test_sampling_makes_a_sampled_loop():
    """Assert that the table ``sampling`` sets the sensors."""
    experiment = read_experiment(FOLDER / "sampled_joint.toml")
    step = 2 * np.pi / 65536
    assert experiment.mode == "sampled"
    assert experiment.sampling == Sampling(1e-3, 60.0, step, 2e-5, 1e-3, 1)


def test_the_other_law_can_be_named(tmp_path: Path):
    """Assert that PD control takes its values from the file."""
    law = 'law = "pd-gravity"\nproportional = 5.0\nderivative = 1.0\n[controller.nominal]\n'
    law += "gravity_torque = 4.0\njoint_stiffness = 90.0"
    start, end = TEXT.index('law = "robust"'), TEXT.index("[reference]")
    text = f"{TEXT[:start]}{law}\n{TEXT[end:]}"
    found = read_experiment(write(tmp_path, text)).loop.controller.parameters
    assert found == {
        "proportional": 5.0,
        "derivative": 1.0,
        "nominal_gravity_torque": 4.0,
        "nominal_joint_stiffness": 90.0,
    }


def but(old: str, new: str, text: str = TEXT) -> str:
    """Return the file with a text replaced."""
    assert old in text
    return text.replace(old, new)


def law_of(text: str) -> str:
    """Return the table of a controller."""
    return text[text.index("[controller]") : text.index("[reference]")]


SPRING, DURATION, MODEL = "= 100.0", "= 30.0 #", 'terms = ["gravity", "motor_viscous"]'
HOSTILE = ("__import__('os').system('true')", "v.__class__", "9**9**9**9", "open('x')")
FAULTS: dict[str, str] = {
    "empty": "",
    "no law": but('law = "robust"', ""),
    "no table": but("[run]", "[[run]]"),
    "name of two lines": but("(2003), ", r"(2003)\n"),
    "unknown key": but("k = 50", "kk = 50"),
    "missing key": but("k = 50.0", ""),
    "law": but('"robust"', '"robustest"'),
    "law is no text": but('"robust"', "[]"),
    "reference": but('"sine"', '"triangle"'),
    "text for a number": but("k = 50.0", 'k = "50"'),
    "truth for a number": but("k = 50.0", "k = true"),
    "not a number": but("k = 50.0", "k = nan"),
    "without end": but(SPRING, "= inf"),
    "too large": but("k = 50.0", "k = 1e300"),
    "negative": but("k = 50.0", "k = -50.0"),
    "no duration": but(DURATION, "= -30.0 #"),
    "endless": but(DURATION, "= 1e9 #"),
    "too short": but(DURATION, "= 1e-4 #"),
    "no spring": but(SPRING, "= 0.0"),
    "pushing spring": but(SPRING, "= -100.0"),
    "no inertia": but("= 1.0 # kg", "= 0.0 # kg"),
    "term": but('"gravity"', '"gravitation"'),
    "term of fits": but('"gravity"', '"backlash"'),
    "term without value": but('"gravity"', '"link_viscous"'),
    "value of no term": but("[plant]", "[plant]\njoint_damping = 1.0"),
    "value missing": but("gravity_torque = 5.0", ""),
    "value of a coefficient": but("[plant]", "[plant]\ntheta1 = 5.0"),
    "estimate of what is known": but("theta1 = 2.5", "beta1 = 2.5"),
    "row": but("link = 1.0", "lonk = 1.0"),
    "state": but("[run]", "[initial_state]\nx7 = 1.0\n[run]"),
    "nominal": but("= 75.0", "= 0.0"),
    "tolerance of a sampled loop": f"{TEXT}[sampling]",
    "noise": but("velocity_noise = 1e-3", "velocity_noise = -1", SAMPLED),
    "no model": but(MODEL, 'file = "none.toml"').replace('known = ["beta1"]', ""),
    "a joint's law for a pendulum": but(law_of(PENDULUM), law_of(TEXT), PENDULUM),
    **{text: but("stiffness*(qd - q)", text, PENDULUM) for text in HOSTILE},
}


def test_faults_of_files(pendulum: Path, refusals: Any, monkeypatch: pytest.MonkeyPatch):
    """Assert that a faulty file is refused in one sentence with file, key and remedy."""
    monkeypatch.chdir(pendulum.parent)

    def read(text: str) -> Experiment:
        return read_experiment(write(Path(), text))

    damped = but('"motor_viscous"]', '"motor_viscous", "joint_damping"]')
    damped = but("[plant]", "[plant]\njoint_damping = 0.2", damped)
    calls = {fault: partial(read, text) for fault, text in FAULTS.items()}
    refusals(calls | {"a term that no observer can have": lambda: read(damped).run()})


def test_method_for_loops_that_are_not_stiff(tmp_path: Path):
    """Assert that the file alone chooses the integrator."""
    explicit = read_experiment(write(tmp_path, TEXT.replace("[run]", "[run]\nstiff = false")))
    assert explicit.side_by_side
    assert "run.stiff" not in explicit.values
