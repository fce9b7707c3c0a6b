"""Estimators: the paper's parametric observer and batch least squares."""
