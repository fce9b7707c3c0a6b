"""Experiments as files: what is simulated, with which values, and what varies over many runs."""

from flexid.experiments.experiment import Experiment
from flexid.experiments.experiment_file import read_experiment

__all__ = ["Experiment", "read_experiment"]
