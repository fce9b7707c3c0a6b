"""Motion of a model within one sampling interval, and its derivatives, for the kernel `segments`.

That kernel is the same for all models. It calls a model's functions by their addresses, all with
the same arguments: two arrays, numbers, and two indices in the array `work`.

Row `row` sticks while its mode is 0. Its velocity, which is zero, and the derivatives of its
velocity then do not change.
"""

from typing import TYPE_CHECKING, Any

from numba import cfunc, types

if TYPE_CHECKING:
    from flexid.kernels.templates.compiled import *
    from flexid.kernels.templates.generated import *
    from flexid.kernels.templates.runge_kutta import *

N_EQUATIONS = N_ROWS + N_MEMORIES

# Layout of the array `work`. First the derivatives of the state, in columns. Next, at each of four
# stages, the derivatives from which these follow: of the rates by the state and by the rest, and of
# memories. Then the derivatives of each row's disturbance, in the same columns.
Z = 0
BY_REST = Z + N_STATES * WIDTH
KEPT_BY_REST = BY_REST + 4 * N_EQUATIONS * WIDTH
DISTURBED = KEPT_BY_REST + 4 * N_MEMORIES * WIDTH
BY_STATE = DISTURBED + N_ROWS * WIDTH
KEPT_BY_STATE = BY_STATE + 4 * N_EQUATIONS * N_STATES
# The state; the end of a step, its last rates and its four stages; and the same three of a trial
# step that locates an event.
X = KEPT_BY_STATE + 4 * N_MEMORIES * N_STATES
STEP = X + N_STATES
ALONE = STEP + 6 * N_STATES
# For each input its start and change over the interval, and the derivatives of both by the delay;
# the inputs and their derivatives at a place.
DRIVE = ALONE + 6 * N_STATES
INPUTS = DRIVE + 4 * N_INPUTS
INPUT_SLOPES = INPUTS + N_INPUTS
# For each row its mode, whether it can stick, and a disturbance, which is an acceleration.
MODES = INPUT_SLOPES + N_INPUTS
DRY_ROWS = MODES + N_ROWS
DISTURBANCE = DRY_ROWS + N_ROWS
COEFFICIENTS = DISTURBANCE + N_ROWS
CONSTANTS = COEFFICIENTS + N_COEFFICIENTS
CORNERS = CONSTANTS + N_CONSTANTS  # function that is zero at each corner, at two places
FREE = CORNERS + 2 * N_CORNERS  # 0 for each row that sticks, else 1
ACTING = FREE + N_ROWS  # mark of each block of terms: whether it acts, or is sought
WORK_SIZE = ACTING + N_BLOCKS

# Layout of the array `columns`: number of columns in use, with the column of the state; column of
# the delay of the inputs; whether a row may stick; and the column of each coefficient.
IN_USE, DELAY, ARE_DRY, AT = range(4)

# Tasks of `run`.
STEP_STATE, CARRY, RATES, LINEARISE, FIND_CORNERS, FIND_ACTING = range(6)

SIZES = (N_STATES, N_ROWS, N_INPUTS, N_COEFFICIENTS, N_CONSTANTS, N_CORNERS, N_EQUATIONS, WIDTH)
PLACES = (Z, DISTURBED, BY_STATE, X, STEP, ALONE, DRIVE)
PLACES += (MODES, DRY_ROWS, DISTURBANCE, COEFFICIENTS, CONSTANTS, CORNERS, WORK_SIZE)


@inlined
def rates_at(x, place, work, rate):
    """Compute the rates of x at a place from 0 to 1 within the interval."""
    u = part(work, INPUTS, N_INPUTS)
    for j in range(N_INPUTS):
        u[j] = work[DRIVE + 4 * j] + place * work[DRIVE + 4 * j + 1]
    modes = part(work, MODES, N_ROWS)
    p = part(work, COEFFICIENTS, N_COEFFICIENTS)
    c, on = part(work, CONSTANTS, N_CONSTANTS), part(work, ACTING, N_BLOCKS)
    state_rates(x, u, modes, p, c, on, rate)
    for row in range(N_ROWS):
        rate[2 * row + 1] += work[DISTURBANCE + row]
        if work[DRY_ROWS + row] != 0.0 and modes[row] == 0.0:
            rate[2 * row + 1] = 0.0


@inlined
def recall(x, start, work):
    """Compute the memories of x from its path since the start of a step."""
    if N_MEMORIES:
        remember(x, start, part(work, COEFFICIENTS, N_COEFFICIENTS))


@uncounted
def slopes_at(x, place, stage, work, columns):
    """Compute the derivatives of the rates at a place from 0 to 1 within the interval."""
    u = part(work, INPUTS, N_INPUTS)
    du = part(work, INPUT_SLOPES, N_INPUTS)
    for j in range(N_INPUTS):
        u[j] = work[DRIVE + 4 * j] + place * work[DRIVE + 4 * j + 1]
        du[j] = work[DRIVE + 4 * j + 2] + place * work[DRIVE + 4 * j + 3]
    a_size, r_size = N_EQUATIONS * N_STATES, N_EQUATIONS * WIDTH
    a = part(work, BY_STATE + stage * a_size, a_size)
    r = part(work, BY_REST + stage * r_size, r_size)
    modes = part(work, MODES, N_ROWS)
    p = part(work, COEFFICIENTS, N_COEFFICIENTS)
    c = part(work, CONSTANTS, N_CONSTANTS)
    on, at = part(work, ACTING, N_BLOCKS), part(columns, AT, N_COEFFICIENTS)
    slopes(x, u, du, modes, p, c, on, at, columns[DELAY], a, r)
    for row in range(N_ROWS):
        work[FREE + row] = 1.0
        if work[DRY_ROWS + row] != 0.0 and modes[row] == 0.0:
            work[FREE + row] = 0.0
            for i in range(N_STATES):
                a[row * N_STATES + i] = 0.0
            for j in range(WIDTH):
                r[row * WIDTH + j] = 0.0


@uncounted
def step(work, place, span, h):
    """Integrate from the state over a span, a fraction of an interval of h seconds."""
    room = (
        part(work, STEP, N_STATES),
        part(work, STEP + N_STATES, N_STATES),
        part(work, STEP + 2 * N_STATES, 4 * N_STATES),
    )
    runge_kutta(part(work, X, N_STATES), place, span, h, work, room)


@uncounted
def carry(work, columns, place, span, h):
    """Advance the derivatives over the last step."""
    x, end = part(work, X, N_STATES), part(work, STEP, N_STATES)
    stages = STEP + 2 * N_STATES
    p, at = part(work, COEFFICIENTS, N_COEFFICIENTS), part(columns, AT, N_COEFFICIENTS)
    for stage in range(4):
        at_stage = part(work, stages + stage * N_STATES, N_STATES)
        slopes_at(at_stage, place + node(stage) * span, stage, work, columns)
        if N_MEMORIES:
            then = part(work, stages + (stage + 1) * N_STATES, N_STATES) if stage < 3 else end
            b_size, q_size = N_MEMORIES * N_STATES, N_MEMORIES * WIDTH
            b = part(work, KEPT_BY_STATE + stage * b_size, b_size)
            q = part(work, KEPT_BY_REST + stage * q_size, q_size)
            memory_slopes(then, x, p, at, b, q)
    b = part(work, KEPT_BY_STATE, 4 * N_MEMORIES * N_STATES)
    q = part(work, KEPT_BY_REST, 4 * N_MEMORIES * WIDTH)
    z = part(work, Z, N_STATES * WIDTH)
    a = part(work, BY_STATE, 4 * N_EQUATIONS * N_STATES)
    r = part(work, BY_REST, 4 * N_EQUATIONS * WIDTH)
    d, free = part(work, DISTURBED, N_ROWS * WIDTH), part(work, FREE, N_ROWS)
    vary(z, columns[IN_USE], span * h, a, r, b, q, d, free)


def _run(work, columns, place, span, h, source, target, what):
    """Do a task of the kernel `segments`; one function, since each costs time to compile."""
    if what == STEP_STATE:
        step(work, place, span, h)
    elif what == CARRY:
        carry(work, columns, place, span, h)
    elif what == RATES:
        rates_at(part(work, source, N_STATES), place, work, part(work, target, N_STATES))
    elif what == LINEARISE:
        slopes_at(part(work, source, N_STATES), place, source - source, work, columns)
    elif what == FIND_CORNERS:
        p = part(work, COEFFICIENTS, N_COEFFICIENTS)
        c = part(work, CONSTANTS, N_CONSTANTS)
        corners(part(work, source, N_STATES), p, c, part(work, target, N_CORNERS))
    elif what == FIND_ACTING:
        p = part(work, COEFFICIENTS, N_COEFFICIENTS)
        acting(p, part(columns, AT, N_COEFFICIENTS), part(work, ACTING, N_BLOCKS))


_RUN: dict[str, Any] = {
    "cache": True,
    "error_model": "numpy",
    "fastmath": {"contract"},
    "_nrt": False,
}
_numbers, _places = types.CPointer(types.float64), types.CPointer(types.int64)
run: Any = cfunc(types.void(_numbers, _places, *[types.float64] * 3, *[types.int64] * 3), **_RUN)(
    _run
)

# The model as an argument of the kernel `segments`.
MODEL = (run.address, *SIZES, *PLACES)
