"""Experiment files: TOML in, a checked `Experiment` out."""

from dataclasses import replace
from functools import partial
from pathlib import Path

from flexid.errors import ExperimentError
from flexid.experiments.experiment import Experiment, declared_experiment
from flexid.experiments.variation_file import read_variation
from flexid.toml_file import parse_toml, read_bytes


def read_experiment(path: str | Path) -> Experiment:
    """Read an experiment file.

    Parameters
    ----------
    path : str or Path
        A TOML file with the tables ``plant``, ``controller``, ``reference``, ``observer`` and
        ``run``, and optionally ``model``, ``initial_estimates``, ``initial_state``, ``sampling``
        and ``campaign``.

    Returns
    -------
    Experiment

    Raises
    ------
    ExperimentError
        If the file cannot be read or used; the text names file, key and remedy.
    """
    path = Path(path)
    refuse = partial(ExperimentError, str(path))
    content = parse_toml(read_bytes(path, "an experiment file in TOML", refuse), refuse)
    campaign = content.pop("campaign", None)
    experiment = declared_experiment(str(path), content)
    if campaign is None:
        return experiment
    return replace(experiment, variation=read_variation(campaign, experiment))
