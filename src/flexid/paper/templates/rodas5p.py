"""Rodas5P: Rosenbrock method of order 5 for stiff problems, with dense output of order 4.

G. Steinebach, "Construction of Rosenbrock-Wanner method Rodas5P and numerical benchmarks within
the Julia Differential Equations package", BIT Numerical Mathematics 63 (2023) 27.
"""

from math import sqrt
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

if TYPE_CHECKING:
    from flexid.kernels.templates.generated import *
    from flexid.kernels.templates.run_status import *
    from flexid.paper.templates.loop_outputs import *


# The formatter would put each number of these tables on a line of its own.
# fmt: off
RODAS_GAMMA = 0.21193756319429014
# The state of stage i is z + sum of A[i, j] times stage j. Each of the last two rows adds the
# previous stage. The last stage is the error estimate; adding it as well gives the new state.
RODAS_A = np.array([
    [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [3.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [2.849394379747939, 0.45842242204463923, 0.0, 0.0, 0.0, 0.0, 0.0],
    [-6.954028509809101, 2.489845061869568, -10.358996098473584, 0.0, 0.0, 0.0, 0.0],
    [2.8029986275628964, 0.5072464736228206, -0.3988312541770524, -0.04721187230404641, 0.0, 0.0,
     0.0],
    [-7.502846399306121, 2.561846144803919, -11.627539656261098, -0.18268767659942256,
     0.030198172008377946, 0.0, 0.0],
    [-7.502846399306121, 2.561846144803919, -11.627539656261098, -0.18268767659942256,
     0.030198172008377946, 1.0, 0.0],
    [-7.502846399306121, 2.561846144803919, -11.627539656261098, -0.18268767659942256,
     0.030198172008377946, 1.0, 1.0],
])
RODAS_C = np.array([
    [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [-14.155112264123755, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [-17.97296035885952, -2.859693295451294, 0.0, 0.0, 0.0, 0.0, 0.0],
    [147.12150275711716, -1.41221402718213, 71.68940251302358, 0.0, 0.0, 0.0, 0.0],
    [165.43517024871676, -0.4592823456491126, 42.90938336958603, -5.961986721573306, 0.0, 0.0, 0.0],
    [24.854864614690072, -3.0009227002832186, 47.4931110020768, 5.5814197821558125,
     -0.6610691825249471, 0.0, 0.0],
    [30.91273214028599, -3.1208243349937974, 77.79954646070892, 34.28646028294783,
     -19.097331116725623, -28.087943162872662, 0.0],
    [37.80277123390563, -3.2571969029072276, 112.26918849496327, 66.9347231244047,
     -40.06618937091002, -54.66780262877968, -9.48861652309627],
])
# Times of the stages over the step, and weights of the right-hand side's time derivative.
RODAS_TIME = np.array([
    0.0, 0.6358126895828704, 0.4095798393397535, 0.9769306725060716, 0.4288403609558664, 1.0, 1.0,
    1.0,
])
RODAS_SLOPE = np.array([
    0.21193756319429014, -0.42387512638858027, -0.3384627126235924, 1.8046452872882734,
    2.325825639765069, 0.0, 0.0, 0.0,
])
# Dense output: weights of the stages for three coefficients.
RODAS_DENSE = np.array([
    [25.948786856663858, -2.5579724845846235, 10.433815404888879, -2.3679251022685204,
     0.524948541321073, 1.1241088310450404, 0.4272876194431874, -0.17202221070155493],
    [-9.91568850695171, -0.9689944594115154, 3.0438037242978453, -24.495224566215796,
     20.176138334709044, 15.98066361424651, -6.789040303419874, -6.710236069923372],
    [11.419903575922262, 2.8879645146136994, 72.92137995996029, 80.12511834622643,
     -52.072871366152654, -59.78993625266729, -0.15582684282751913, 4.883087185713722],
])
# fmt: on


@njit(**within)
def lu_factor(matrix, pivots):
    """Overwrite a matrix with its LU factors, with partial pivoting.

    The diagonal contains the reciprocals of the pivots, which the solutions need many times.
    """
    for column in range(SIZE):
        pivot = column
        largest = abs(matrix[column, column])
        for row in range(column + 1, SIZE):
            size = abs(matrix[row, column])
            if size > largest:
                largest = size
                pivot = row
        pivots[column] = pivot
        if pivot != column:
            for j in range(SIZE):
                swapped = matrix[column, j]
                matrix[column, j] = matrix[pivot, j]
                matrix[pivot, j] = swapped
        reciprocal = 1.0 / matrix[column, column]
        matrix[column, column] = reciprocal
        for row in range(column + 1, SIZE):
            factor = matrix[row, column]
            if factor != 0.0:
                factor *= reciprocal
                matrix[row, column] = factor
                for j in range(column + 1, SIZE):
                    matrix[row, j] -= factor * matrix[column, j]


@njit(**within)
def lu_solve(matrix, pivots, b):
    """Overwrite b with the solution, for a factorised matrix."""
    for row in range(SIZE):
        other = pivots[row]
        if other != row:
            b[row], b[other] = b[other], b[row]
    for row in range(1, SIZE):
        total = b[row]
        for j in range(row):
            total -= matrix[row, j] * b[j]
        b[row] = total
    for row in range(SIZE - 1, -1, -1):
        total = b[row]
        for j in range(row + 1, SIZE):
            total -= matrix[row, j] * b[j]
        b[row] = total * matrix[row, row]


@njit(**within)
def rosenbrock_step(t, h, z, p, dz, slope, matrix, pivots, stages, trial, new):
    """Take a step from z to new, and fill the stages, of which the last is the error estimate."""
    per_h = 1.0 / h
    for i in range(SIZE):
        stages[0, i] = dz[i] + h * RODAS_SLOPE[0] * slope[i]
    lu_solve(matrix, pivots, stages[0])
    for stage in range(1, 8):
        # With the loop over components innermost, the compiler uses vector instructions.
        for i in range(SIZE):
            trial[i] = z[i]
            stages[stage, i] = h * RODAS_SLOPE[stage] * slope[i]
        for j in range(stage):
            a = RODAS_A[stage, j]
            c = RODAS_C[stage, j] * per_h
            for i in range(SIZE):
                trial[i] += a * stages[j, i]
                stages[stage, i] += c * stages[j, i]
        rates(t + RODAS_TIME[stage] * h, trial, p, new)
        for i in range(SIZE):
            stages[stage, i] += new[i]
        lu_solve(matrix, pivots, stages[stage])
    for i in range(SIZE):
        new[i] = trial[i] + stages[7, i]


@njit(**within)
def interpolate(t, h, z, new, stages, dense, start, sample_time, samples, filled):
    """Fill the samples between t and t + h; return the number of all filled samples."""
    ready = False
    while filled < samples.shape[0]:
        # Up to rounding, the last sample of a run is at the end of its last step.
        place = (start + filled * sample_time - t) / h
        if place > 1.0 + 1e-9:
            break
        if not ready:
            for row in range(3):
                for i in range(SIZE):
                    value = 0.0
                    for stage in range(8):
                        value += RODAS_DENSE[row, stage] * stages[stage, i]
                    dense[row, i] = value
            ready = True
        rest = 1.0 - place
        for i in range(SIZE):
            inner = dense[0, i] + place * (dense[1, i] + place * dense[2, i])
            samples[filled, i] = rest * z[i] + place * (new[i] + rest * inner)
        filled += 1
    return filled


@njit(**within)
def integrate_run(span, z, p, steps, sampling, totals, counts):
    """Integrate one run; return its status and the time reached."""
    start, stop = span
    relative, absolute, first_step, longest_step, limit, most_steps = steps
    sample_time, samples = sampling
    dz = np.empty(SIZE)
    slope = np.empty(SIZE)
    trial = np.empty(SIZE)
    new = np.empty(SIZE)
    jacobian = np.zeros((SIZE, SIZE))
    matrix = np.empty((SIZE, SIZE))
    pivots = np.empty(SIZE, np.int64)
    stages = np.empty((8, SIZE))
    dense = np.empty((3, SIZE))
    t = start
    h = first_step
    filled = 0
    accepted = 0
    rejected = 0
    after_rejection = False
    measured = totals.shape[0] > 0
    before = 0.0  # length of the previous accepted step
    status = FINISHED
    if samples.shape[0] > 0:
        for i in range(SIZE):  # an array assignment takes three seconds longer to compile
            samples[0, i] = z[i]
        filled = 1
    rates_and_jacobian(t, z, p, dz, jacobian, slope)
    while t < stop:
        if accepted + rejected >= most_steps:
            status = TOO_MANY_STEPS
            break
        h = min(h, longest_step)
        last = t + h >= stop
        if last:
            h = stop - t
        for i in range(SIZE):
            for j in range(SIZE):
                matrix[i, j] = -jacobian[i, j]
            matrix[i, i] += 1.0 / (h * RODAS_GAMMA)
        lu_factor(matrix, pivots)
        rosenbrock_step(t, h, z, p, dz, slope, matrix, pivots, stages, trial, new)
        error = 0.0
        for i in range(SIZE):
            scale = absolute + relative * max(abs(z[i]), abs(new[i]))
            error += (stages[7, i] / scale) ** 2
        error = sqrt(error / SIZE)
        if error <= 1.0:
            filled = interpolate(t, h, z, new, stages, dense, start, sample_time, samples, filled)
            if measured:
                observe(t, 0.5 * (before + h), z, p, totals)
                before = h
            t = stop if last else t + h
            accepted += 1
            largest = 0.0
            for i in range(SIZE):
                z[i] = new[i]
                largest = max(largest, abs(new[i]))
            if largest > limit:
                status = DIVERGED
                break
            rates_and_jacobian(t, z, p, dz, jacobian, slope)
            growth = min(5.0, max(0.2, 0.9 * max(error, 1e-10) ** (-0.2)))
            h *= min(growth, 1.0) if after_rejection else growth
            after_rejection = False
        else:
            rejected += 1
            after_rejection = True
            finite = error < np.inf
            h *= max(0.1, 0.9 * error ** (-0.2)) if finite else 0.1
            if t + h * 0.01 <= t:
                status = STEP_TOO_SMALL if finite else NOT_FINITE
                break
    if measured:
        observe(t, 0.5 * before, z, p, totals)
    counts[0] = accepted
    counts[1] = rejected
    counts[2] = filled
    return status, t


@njit(cache=True, error_model="numpy", nogil=True)
def integrate(span, z, p, steps, sampling, totals, results):
    """Integrate z' = rates(t, z, p) over a span, for several runs, one per row.

    span      start and stop
    z         overwritten by the final state
    steps     relative and absolute tolerance, of which absolute + relative |z[i]| is allowed; first
              and longest step; magnitude of a component beyond which the run has diverged; largest
              number of steps
    sampling  sample time, and samples, (n_runs, n, SIZE), filled with z at start, start +
              sample_time, ...; n may be 0
    totals    passed to observe at every accepted step, for the trapezoidal rule; without columns if
              there are no measures
    results   filled with the status of each run, the time it reached, and its numbers of accepted
              steps, rejected steps and filled samples
    """
    sample_time, samples = sampling
    status, reached, counts = results
    for run in range(z.shape[0]):
        status[run], reached[run] = integrate_run(
            span, z[run], p[run], steps, (sample_time, samples[run]), totals[run], counts[run]
        )
