"""Estimators: the paper's parametric observer, least squares and segmented prediction error."""
