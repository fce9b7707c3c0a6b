"""Realistic trials: several sins at once, and the low-frequency physics as the truth."""
