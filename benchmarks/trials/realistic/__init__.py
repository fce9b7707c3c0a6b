"""Realistic trials: several imperfections ("sins") at once, with low-frequency values as truth."""
