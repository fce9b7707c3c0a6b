"""Outcome of a run, and options to compile functions that only compiled code calls."""

from typing import Any

# Wrappers for Python and for C would double the time to compile them.
within: Any = {"error_model": "numpy", "no_cpython_wrapper": True, "no_cfunc_wrapper": True}

FINISHED = 0
TOO_MANY_STEPS = 1
STEP_TOO_SMALL = 2
NOT_FINITE = 3
DIVERGED = 4

BOUND = 1e12  # magnitude beyond which a motion has diverged: an angle has lost its digits
