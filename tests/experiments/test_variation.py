"""The campaign of an experiment file: what varies and what is kept."""

from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from flexid.errors import ExperimentError
from flexid.experiments import read_experiment
from flexid.experiments.variation import MEASURES, Distribution, Variation

TEXT = (Path(__file__).parents[2] / "experiments" / "huang2003.toml").read_text(encoding="utf-8")


def variation(folder: Path, campaign: str) -> Variation:
    """Read Table I with a campaign."""
    path = folder / "experiment.toml"
    path.write_text(f"{TEXT}\n[campaign]\n{campaign}", encoding="utf-8")
    found = read_experiment(path).variation
    assert found is not None
    return found


def test_dotted_keys_need_no_quotes(tmp_path: Path):
    """Assert that paths may be written as TOML's dotted keys or as one quoted key."""
    head = 'kind = "sobol"\nruns = 8\n[campaign.vary]\n'
    bare = variation(tmp_path, head + "controller.k = { uniform = [10, 50] }")
    quoted = variation(tmp_path, head + '"controller.k" = { uniform = [10, 50] }')
    assert bare == quoted
    assert bare.inputs == {"controller.k": Distribution("uniform", 10.0, 50.0)}
    assert bare.keep == MEASURES


def test_grid_has_every_combination(tmp_path: Path):
    """Assert that a grid's runs are the product of its lists."""
    grid = variation(
        tmp_path,
        'kind = "grid"\n[campaign.vary]\ncontroller.k = [10, 20, 30]\n'
        "observer.link = [1, 2]\ncontroller.exponents.1 = [1, 2]",
    )
    assert grid.runs == 12
    assert grid.inputs["observer.link"] == (1.0, 2.0)


K = "vary.controller.k"

OF_THE_CAMPAIGN = [
    ('kind = "sobol"\nruns = 8', "vary"),
    ('kind = "random"\nruns = 8\nvary = {a = [1]}', "kind"),
    (f'kind = "sobol"\n{K} = [1]', "runs"),
    (f'kind = "sobol"\nruns = 0\n{K} = [1]', "runs"),
    (f'kind = "sobol"\nruns = 8\nkeep = ["all"]\n{K} = [1]', "keep.1"),
    (f'kind = "grid"\nruns = 3\n{K} = [1]', "runs"),
    (f'kind = "grid"\n{K} = {{uniform = [1, 2]}}', K),
    (f'kind = "grid"\n{K} = [1, 9007199254740993]', f"{K}.2"),
    (f'kind = "grid"\n{K} = [1{400 * "0"}]', f"{K}.1"),
    (f'kind = "sobol"\nruns = 8\n{K} = [1]\nvary."controller.k" = [2]', K),
]
OF_AN_INPUT = [
    ("vary.controller.kk = [1]", "vary.controller.kk"),
    ("vary.run.maximum_steps = {uniform = [10, 20]}", "vary.run.maximum_steps"),
    (f"{K} = 3", K),
    (f"{K} = []", K),
    (f'{K} = ["1"]', K),
    (f"{K} = {{uniform = [2, 1]}}", f"{K}.uniform"),
    (f"{K} = {{uniform = [-2, 1]}}", K),
    (f"{K} = {{normal = [2, 0]}}", f"{K}.normal"),
    (f"{K} = {{log_uniform = [0, 1]}}", f"{K}.log_uniform"),
    (f"{K} = {{uniform = [1, 2], normal = [1, 2]}}", K),
]


@pytest.mark.parametrize(
    ("campaign", "key"),
    OF_THE_CAMPAIGN + [(f'kind = "sobol"\nruns = 8\n{text}', key) for text, key in OF_AN_INPUT],
)
def test_campaign_that_cannot_be_run_is_refused(campaign: str, key: str, tmp_path: Path):
    """Assert that a campaign is tried when it is read, and refused by its key."""
    with pytest.raises(ExperimentError) as caught:
        variation(tmp_path, campaign)
    assert caught.value.key.startswith(f"campaign.{key}")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("distribution", "truth"),
    [
        (Distribution("uniform", 2.0, 5.0), stats.uniform(2.0, 3.0)),
        (Distribution("log_uniform", 0.1, 10.0), stats.loguniform(0.1, 10.0)),
        (Distribution("normal", 1.0, 0.3), stats.norm(1.0, 0.3)),
    ],
)
def test_quantiles_are_those_of_the_distribution(distribution: Distribution, truth):
    """Assert that quantiles agree with SciPy's."""
    shares = np.linspace(0.01, 0.99, 50)
    assert distribution.quantile(shares) == pytest.approx(truth.ppf(shares))


def test_integers_are_equally_likely_with_both_ends():
    """Assert that each whole number gets the same share."""
    shares = (np.arange(4000) + 0.5) / 4000
    values, counts = np.unique(
        Distribution("integers", 3.0, 6.0).quantile(shares), return_counts=True
    )
    assert values.tolist() == [3, 4, 5, 6]
    assert set(counts) == {1000}
