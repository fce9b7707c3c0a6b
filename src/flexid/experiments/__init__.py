"""Experiments as files: what is simulated, with which values, and what varies over many runs."""

from flexid.experiments.experiment import Experiment, read_experiment

__all__ = ["Experiment", "read_experiment"]
