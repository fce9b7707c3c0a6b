"""Values of an experiment that can be set, and the variations of a campaign."""

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
from flexid.simulation.closed_loop import loop_kernel
from flexid.studies.runs import PHYSICAL, table1_loop

FOLDER = Path(__file__).parents[2] / "experiments"


@pytest.fixture(scope="module")
def table1() -> Experiment:
    """Return Table I as an experiment."""
    return read_experiment(FOLDER / "huang2003.toml")


@pytest.fixture(scope="module")
def sampled() -> Experiment:
    """Return the sampled joint."""
    return read_experiment(FOLDER / "sampled_joint.toml")


def test_exponents_change_the_gains_but_no_kernel(table1: Experiment):
    """Assert that other exponents reach the loop, with the same compiled kernel."""
    changed = table1.with_values({"controller.exponents.3": 2.0})
    assert changed.loop.controller.values["gain3"] == 50.0**2 * 0.42
    assert changed.loop.declaration is table1.loop.declaration
    gain3 = changed.loop.declaration.parameter_names.index("gain3")
    assert changed.loop.parameters[gain3] == 50.0**2 * 0.42


def test_inertia_changes_what_is_known(table1: Experiment):
    """Assert that a physical parameter changes all its coefficients, also known ones."""
    loop = table1.with_values({"plant.motor_inertia": 0.25}).loop
    assert loop.coefficients["alpha1"] == PHYSICAL["joint_stiffness"] / 0.25
    assert loop.system.constants["beta1"] == 4.0
    assert loop.coefficients["theta2"] == table1.loop.coefficients["theta2"]


def test_other_values_need_no_other_kernel(table1: Experiment):
    """Assert that k, plant, observer, start and reference share one compiled loop."""
    values = {
        "controller.k": 15.0,
        "controller.nominal.link_inertia": 0.9,
        "plant.joint_stiffness": 80.0,
        "plant.motor_inertia": 0.35,
        "observer.link": 3.0,
        "initial_estimates.theta1": 1.0,
        "initial_state.x1": 0.1,
        "reference.amplitude": 2.0,
    }
    changed = table1.with_values(values)
    assert changed.loop.declaration is table1.loop.declaration
    assert changed.loop.declaration.digests == table1_loop((1, 2, 3)).declaration.digests
    assert loop_kernel(changed.loop.declaration) is loop_kernel(table1.loop.declaration)
    for path, value in values.items():
        assert changed.values[path] == value


OUT_OF_RANGE: list[tuple[str, float]] = [
    *(("controller.k", -1.0), ("controller.k", float("nan")), ("sampling.seed", 1.5)),
    *(("sampling.position_noise", -1e-9), ("plant.link_inertia", 0.0), ("run.duration", 0.0)),
    ("plant.alpha1", 3.0),  # no valid path: the likely one is proposed
]


def test_values_out_of_range(refusals: Any, sampled: Experiment, monkeypatch: Any):
    """Assert that set values are checked as strictly as those of a file."""
    monkeypatch.chdir(FOLDER)
    table1 = read_experiment("huang2003.toml")

    def change(path: str, value: float) -> Experiment:
        other = replace(sampled, path="sampled.toml")
        return (other if "sampling" in path else table1).with_values({path: value})

    refusals({f"{path} = {v}": partial(change, path, v) for path, v in OUT_OF_RANGE})


@pytest.mark.parametrize(
    "path", ["plant.gravity_torque", "run.relative_tolerance", "observer.link"]
)
def test_digest_covers_what_decides(path: str, table1: Experiment, tmp_path: Path):
    """Assert that every decisive value changes the digest, and that title and path do not."""
    changed = table1.with_values({path: table1.values[path] / 2})
    assert changed.digest != table1.digest
    text = (FOLDER / "huang2003.toml").read_text(encoding="utf-8")
    copy = tmp_path / "copy.toml"
    copy.write_text(text.replace('name = "Huang (2003), Table I"', ""), encoding="utf-8")
    assert read_experiment(copy).digest == table1.digest


@settings(max_examples=20)
@given(
    amplitudes=st.lists(st.floats(1e-3, 1.0), min_size=3, max_size=3),
    inertia=st.floats(1e-3, 1e3),
    seed=st.integers(0, 2**31),
)
def test_any_values_are_those_of_a_file_that_says_so(
    tmp_path: Path, sampled: Experiment, amplitudes: list[float], inertia: float, seed: int
):
    """Assert that set values give the same experiment as a file with these values."""
    text = (FOLDER / "sampled_joint.toml").read_text(encoding="utf-8")
    written = tmp_path / "written.toml"
    written.write_text(
        text.replace("[0.6, 0.3, 0.1]", repr(amplitudes))
        .replace("motor_inertia = 0.3 ", f"motor_inertia = {inertia!r} ")
        .replace("seed = 1", f"seed = {seed}")
        .replace("[run]", f"[initial_state]\nx1 = {inertia!r}\n[run]"),
        encoding="utf-8",
    )
    values = {"plant.motor_inertia": inertia, "sampling.seed": float(seed)}
    values["initial_state.x1"] = inertia
    values |= {f"reference.amplitudes.{i}": value for i, value in enumerate(amplitudes, 1)}
    changed, expected = sampled.with_values(values), read_experiment(written)
    assert changed.digest == expected.digest
    assert changed.sampling == expected.sampling
    assert changed.loop.parameters.tolist() == expected.loop.parameters.tolist()
    assert changed.loop.initial_state == expected.loop.initial_state == (inertia, 0.0, 0.0, 0.0)


TEXT = (Path(__file__).parents[2] / "experiments" / "huang2003.toml").read_text(encoding="utf-8")


def variation(folder: Path, campaign: str) -> Variation:
    """Read Table I with a campaign."""
    path = folder / "experiment.toml"
    path.write_text(f"{TEXT}\n[campaign]\n{campaign}", encoding="utf-8")
    found = read_experiment(path).variation
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


def test_campaigns_that_cannot_be_run(tmp_path: Path, refusals: Any, monkeypatch: Any):
    """Assert that a campaign is checked when it is read, and refused by its key."""
    monkeypatch.chdir(tmp_path)
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
