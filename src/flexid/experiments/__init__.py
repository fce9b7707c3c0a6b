"""Experiment files, and campaigns of many runs: plan, run, store, resume and summarise."""
