"""Flexid beside other tools on the same jobs: ``python -m benchmarks``."""
