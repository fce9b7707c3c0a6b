"""What became of a run."""

FINISHED = 0
TOO_MANY_STEPS = 1
STEP_TOO_SMALL = 2
NOT_FINITE = 3
DIVERGED = 4

BOUND = 1e12  # size of a number beyond which a motion has diverged: an angle has lost its digits
