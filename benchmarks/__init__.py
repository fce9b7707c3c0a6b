"""Benchmarks of flexid, also against other tools: ``python -m benchmarks``."""
