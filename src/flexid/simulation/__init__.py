"""Closed loops: continuous and sampled-data."""
