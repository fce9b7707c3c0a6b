"""Fit of the full model, with every usual term, to data."""
