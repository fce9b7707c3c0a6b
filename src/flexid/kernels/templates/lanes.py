"""Several runs side by side in one flat array w: number `slot` of run `lane` is w[at(slot, lane)].

A loop over lanes that has neither branch nor call becomes vector instructions. It would not with an
array of two dimensions, or one for each kind of number, because then LLVM cannot tell that slots do
not overlap. A run's numbers do not depend on LANES.
"""

from typing import TYPE_CHECKING

from numba import njit

if TYPE_CHECKING:
    from flexid.kernels.templates.generated import *
    from flexid.kernels.templates.loop_measures import *


TIME = 0  # of the state
STEP = 1  # length of the step that is tried
END = 2  # time at its end
STAGE_TIME = 3
BEFORE = 4  # length of the step that led to the state
ERROR = 5  # mean square of the estimated errors over what is allowed
REJECTED = 6  # 1 where the last step was, or else 0
RUN = 7  # its number, or -1 where there is none
ACCEPTED_STEPS = 8
REJECTED_STEPS = 9
STATUS = 10  # what became of the run, or GOES_ON
GROWTH = 11  # of the next step over this one
WEIGHT = 12  # of the state in means over time
STATE = 13
STAGE = STATE + SIZE  # state of a stage, at last the new one
PARAMETERS = STAGE + SIZE
EARLIER = PARAMETERS + N_PARAMETERS  # rates of six earlier stages
RATES = EARLIER + 6 * SIZE  # at STAGE
OBSERVED = RATES + SIZE  # what measures are taken of, at STATE
NEXT_OBSERVED = OBSERVED + N_OBSERVED  # and at STAGE
TOTALS = NEXT_OBSERVED + N_OBSERVED
SLOTS = TOTALS + N_MEASURES

GOES_ON = -1


@njit(cache=True, error_model="numpy", forceinline=True)
def at(slot, lane):
    """Where number `slot` of run `lane` is."""
    return slot * LANES + lane
