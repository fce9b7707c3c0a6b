"""Experiment files, and campaigns of many runs: plan, run, store, resume and summarise."""

from flexid.experiments.experiment import Experiment, read_experiment

__all__ = ["Experiment", "read_experiment"]
