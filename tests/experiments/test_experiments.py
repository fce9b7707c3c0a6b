"""Experiment files, values that can be set, variations of a campaign, and refusals."""

import pickle
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from flexid.experiments.experiment import Experiment, read_experiment
from flexid.experiments.variation import Distribution, Variation
from flexid.simulation.closed_loop import loop_kernel, simulate
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


def test_an_experiment_with_its_own_model(pendulum: Path):
    """Assert a path relative to the experiment, and a pickled one without its model file."""
    experiment = read_experiment(pendulum)
    assert experiment.loop.system.constants == {"inertia": 0.05}
    assert experiment.values["plant.inertia"] == 0.05
    run = experiment.run()
    assert abs(run.tracking_error[-1]) < abs(run.tracking_error[0])
    sent = pickle.dumps(read_experiment(pendulum))
    (pendulum.parent / "pendulum.toml").unlink()
    arrived = pickle.loads(sent).with_values({"controller.parameters.stiffness": 3.0})
    assert arrived.loop.controller.parameters == {"stiffness": 3.0}


def test_other_files_of_table_1(tmp_path: Path):
    """Assert that campaign and byte-order mark leave the loop of Table I as it is."""
    campaign = read_experiment(FOLDER / "huang2003_campaign.toml")
    assert campaign.loop.parameters.tolist() == table1_loop((1, 2, 3)).parameters.tolist()
    assert campaign.digest == read_experiment(FOLDER / "huang2003.toml").digest
    marked = read_experiment(write(tmp_path, b"\xef\xbb\xbf" + TEXT.encode()))
    assert marked.digest == read_experiment(FOLDER / "huang2003.toml").digest


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


def test_tables_choose_law_and_loop(tmp_path: Path):
    """Assert PD control by the file's values, sensors by sampling, the method by run."""
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
    experiment = read_experiment(FOLDER / "sampled_joint.toml")
    step = 2 * np.pi / 65536
    assert experiment.mode == "sampled"
    assert experiment.sampling == Sampling(1e-3, 60.0, step, 2e-5, 1e-3, 1)
    explicit = read_experiment(write(tmp_path, TEXT.replace("[run]", "[run]\nstiff = false")))
    assert explicit.side_by_side
    assert "run.stiff" not in explicit.values


TABLE1 = read_experiment(FOLDER / "huang2003.toml")
SAMPLED_JOINT = read_experiment(FOLDER / "sampled_joint.toml")


def test_other_values_need_no_other_kernel():
    """Assert that gains, plant, observer, start and reference share one compiled loop."""
    values = {
        "controller.k": 15.0,
        "controller.exponents.3": 2.0,
        "controller.nominal.link_inertia": 0.9,
        "plant.joint_stiffness": 80.0,
        "plant.motor_inertia": 0.35,
        "observer.link": 3.0,
        "initial_estimates.theta1": 1.0,
        "initial_state.x1": 0.1,
        "reference.amplitude": 2.0,
    }
    changed = TABLE1.with_values(values)
    assert changed.loop.declaration is TABLE1.loop.declaration
    assert changed.loop.declaration.digests == table1_loop((1, 2, 3)).declaration.digests
    assert loop_kernel(changed.loop.declaration) is loop_kernel(TABLE1.loop.declaration)
    assert values.items() <= changed.values.items()
    assert changed.loop.controller.values["gain3"] == 15.0**2 * 0.42


OUT_OF_RANGE: list[tuple[str, float]] = [
    *(("controller.k", -1.0), ("controller.k", float("nan")), ("sampling.seed", 1.5)),
    *(("sampling.position_noise", -1e-9), ("plant.link_inertia", 0.0), ("run.duration", 0.0)),
    ("plant.alpha1", 3.0),  # no valid path: the likely one is proposed
]


def test_values_out_of_range(refusals: Any, monkeypatch: Any):
    """Assert that set values are checked as strictly as those of a file."""
    monkeypatch.chdir(FOLDER)
    table1 = read_experiment("huang2003.toml")

    def change(path: str, value: float) -> Experiment:
        other = replace(SAMPLED_JOINT, path="sampled.toml")
        return (other if "sampling" in path else table1).with_values({path: value})

    refusals({f"{path} = {v}": partial(change, path, v) for path, v in OUT_OF_RANGE})


@pytest.mark.parametrize(
    "path", ["plant.gravity_torque", "run.relative_tolerance", "observer.link"]
)
def test_digest_covers_what_decides(path: str, tmp_path: Path):
    """Assert that every decisive value changes the digest, and that title and path do not."""
    changed = TABLE1.with_values({path: TABLE1.values[path] / 2})
    assert changed.digest != TABLE1.digest
    copy = tmp_path / "copy.toml"
    copy.write_text(TEXT.replace('name = "Huang (2003), Table I"', ""), encoding="utf-8")
    assert read_experiment(copy).digest == TABLE1.digest


@settings(max_examples=20)
@given(
    amplitudes=st.lists(st.floats(1e-3, 1.0), min_size=3, max_size=3),
    inertia=st.floats(1e-3, 1e3),
    seed=st.integers(0, 2**31),
)
def test_any_values_are_those_of_a_file_that_says_so(
    tmp_path: Path, amplitudes: list[float], inertia: float, seed: int
):
    """Assert that set values give the same experiment as a file with these values."""
    written = tmp_path / "written.toml"
    written.write_text(
        SAMPLED.replace("[0.6, 0.3, 0.1]", repr(amplitudes))
        .replace("motor_inertia = 0.3 ", f"motor_inertia = {inertia!r} ")
        .replace("seed = 1", f"seed = {seed}")
        .replace("[run]", f"[initial_state]\nx1 = {inertia!r}\n[run]"),
        encoding="utf-8",
    )
    values = {"plant.motor_inertia": inertia, "sampling.seed": float(seed)}
    values["initial_state.x1"] = inertia
    values |= {f"reference.amplitudes.{i}": value for i, value in enumerate(amplitudes, 1)}
    changed, expected = SAMPLED_JOINT.with_values(values), read_experiment(written)
    assert changed.digest == expected.digest
    assert changed.sampling == expected.sampling
    assert changed.loop.parameters.tolist() == expected.loop.parameters.tolist()
    assert changed.loop.initial_state == expected.loop.initial_state == (inertia, 0.0, 0.0, 0.0)


def variation(folder: Path, campaign: str) -> Variation:
    """Read Table I with a campaign."""
    found = read_experiment(write(folder, f"{TEXT}\n[campaign]\n{campaign}")).variation
    assert found is not None
    return found


def test_dotted_keys_need_no_quotes(tmp_path: Path):
    """Assert that paths may be dotted keys of TOML or one quoted key."""
    head = 'kind = "sobol"\nruns = 8\n[campaign.vary]\n'
    bare = variation(tmp_path, head + "controller.k = { uniform = [10, 50] }")
    quoted = variation(tmp_path, head + '"controller.k" = { uniform = [10, 50] }')
    assert bare == quoted
    assert bare.vary == {"controller.k": Distribution(uniform=[10.0, 50.0])}


K = "vary.controller.k"

SOBOL = 'kind = "sobol"\nruns = 8'
CAMPAIGNS = (
    SOBOL,
    'kind = "random"\nruns = 8\nvary = {a = [1]}',
    f'kind = "sobol"\n{K} = [1]',
    f'kind = "sobol"\nruns = 0\n{K} = [1]',
    f'kind = "grid"\nruns = 3\n{K} = [1]',
    f'kind = "grid"\n{K} = {{uniform = [1, 2]}}',
    f'kind = "grid"\n{K} = [1, 9007199254740993]',
    f'kind = "grid"\n{K} = [1{400 * "0"}]',
    f'{SOBOL}\n{K} = [1]\nvary."controller.k" = [2]',
    f"{SOBOL}\nvary.controller.kk = [1]",
    f"{SOBOL}\nvary.run.maximum_steps = {{uniform = [10, 20]}}",
    *(f"{SOBOL}\n{K} = {value}" for value in ("3", "[]", '["1"]')),
    *(f"{SOBOL}\n{K} = {{uniform = {pair}}}" for pair in ("[2, 1]", "[-2, 1]")),
    f"{SOBOL}\n{K} = {{normal = [2, 0]}}",
    f"{SOBOL}\n{K} = {{log_uniform = [0, 1]}}",
    f"{SOBOL}\n{K} = {{uniform = [1, 2], normal = [1, 2]}}",
)


def test_campaigns_that_cannot_be_run(here: Path, refusals: Any):
    """Assert that a campaign is checked when it is read, and refused by its key."""
    refusals({repr(text)[:80]: partial(variation, Path(), text) for text in CAMPAIGNS})


@pytest.mark.parametrize(
    ("distribution", "truth"),
    [
        (Distribution(uniform=[2.0, 5.0]), stats.uniform(2.0, 3.0)),
        (Distribution(log_uniform=[0.1, 10.0]), stats.loguniform(0.1, 10.0)),
        (Distribution(normal=[1.0, 0.3]), stats.norm(1.0, 0.3)),
    ],
)
def test_quantiles_are_those_of_the_distribution(distribution: Distribution, truth):
    """Assert that quantiles agree with SciPy's."""
    shares = np.linspace(0.01, 0.99, 50)
    assert distribution.quantile(shares) == pytest.approx(truth.ppf(shares))


def test_integers_are_equally_likely_with_both_ends():
    """Assert that all integers are equally likely, both ends included."""
    shares = (np.arange(4000) + 0.5) / 4000
    values, counts = np.unique(Distribution(integers=[3, 6]).quantile(shares), return_counts=True)
    assert values.tolist() == [3, 4, 5, 6]
    assert set(counts) == {1000}
