"""Experiments as files, and campaigns of many runs: planned, run, kept, resumed, summarised."""

from flexid.experiments.experiment import Experiment, read_experiment

__all__ = ["Experiment", "read_experiment"]
