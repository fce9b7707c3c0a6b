"""The size of a number beyond which a motion counts as diverged: an angle has lost its digits."""

BOUND = 1e12
