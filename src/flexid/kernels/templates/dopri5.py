# Explicit Runge-Kutta method of order 5 for problems that are not stiff, with a dense output of order 4.
# J. R. Dormand and P. J. Prince, "A family of embedded Runge-Kutta formulae", Journal of Computational
# and Applied Mathematics 6 (1980) 19-26; dense output by L. F. Shampine as in E. Hairer, S. P. Norsett,
# G. Wanner, "Solving Ordinary Differential Equations I", section II.6.
# Needs run_status and SIZE; calls rates(t, z, p, dz) and, where measures are wanted,
# observe(t, weight, z, p, totals).

# Dense output: weights of the stages in its term of highest order.
DORMAND_DENSE = (-12715105075.0 / 11282082432.0, 0.0, 87487479700.0 / 32700410799.0, -10690763975.0 / 1880347072.0, 701980252875.0 / 199316789632.0, -1453857185.0 / 822651844.0, 69997945.0 / 29380423.0)


@njit(cache=True, error_model="numpy")
def dormand_step(t, h, z, p, stages, new):
    """One step from z to new; the first stage is there already, the last one is the rates at new."""
    k = stages
    for i in range(SIZE):
        new[i] = z[i] + h * (1.0 / 5.0 * k[0, i])
    rates(t + 0.2 * h, new, p, k[1])
    for i in range(SIZE):
        new[i] = z[i] + h * (3.0 / 40.0 * k[0, i] + 9.0 / 40.0 * k[1, i])
    rates(t + 0.3 * h, new, p, k[2])
    for i in range(SIZE):
        new[i] = z[i] + h * (44.0 / 45.0 * k[0, i] - 56.0 / 15.0 * k[1, i] + 32.0 / 9.0 * k[2, i])
    rates(t + 0.8 * h, new, p, k[3])
    for i in range(SIZE):
        new[i] = z[i] + h * (19372.0 / 6561.0 * k[0, i] - 25360.0 / 2187.0 * k[1, i] + 64448.0 / 6561.0 * k[2, i] - 212.0 / 729.0 * k[3, i])
    rates(t + 8.0 / 9.0 * h, new, p, k[4])
    for i in range(SIZE):
        new[i] = z[i] + h * (9017.0 / 3168.0 * k[0, i] - 355.0 / 33.0 * k[1, i] + 46732.0 / 5247.0 * k[2, i] + 49.0 / 176.0 * k[3, i] - 5103.0 / 18656.0 * k[4, i])
    rates(t + h, new, p, k[5])
    for i in range(SIZE):
        new[i] = z[i] + h * (35.0 / 384.0 * k[0, i] + 500.0 / 1113.0 * k[2, i] + 125.0 / 192.0 * k[3, i] - 2187.0 / 6784.0 * k[4, i] + 11.0 / 84.0 * k[5, i])
    rates(t + h, new, p, k[6])


@njit(cache=True, error_model="numpy")
def dormand_error(h, z, new, k, relative, absolute):
    """Root mean square of the estimated errors over what is allowed."""
    total = 0.0
    for i in range(SIZE):
        error = h * (71.0 / 57600.0 * k[0, i] - 71.0 / 16695.0 * k[2, i] + 71.0 / 1920.0 * k[3, i] - 17253.0 / 339200.0 * k[4, i] + 22.0 / 525.0 * k[5, i] - 1.0 / 40.0 * k[6, i])
        total += (error / (absolute[i] + relative * max(abs(z[i]), abs(new[i])))) ** 2
    return sqrt(total / SIZE)


@njit(cache=True, error_model="numpy")
def interpolate(t, h, z, new, stages, start, sample_time, samples, filled):
    """Fill the samples that lie in the step from t to t + h; return how many are filled in all."""
    while filled < samples.shape[0]:
        # The last sample of a run falls on its last step's end, up to rounding.
        place = (start + filled * sample_time - t) / h
        if place > 1.0 + 1e-9:
            break
        rest = 1.0 - place
        for i in range(SIZE):
            highest = 0.0
            for stage in range(7):
                highest += DORMAND_DENSE[stage] * stages[stage, i]
            change = new[i] - z[i]
            first = h * stages[0, i] - change
            last = change - h * stages[6, i] - first
            inner = change + rest * (first + place * (last + rest * h * highest))
            samples[filled, i] = new[i] if rest == 0.0 else z[i] + place * inner
        filled += 1
    return filled


@njit(cache=True, error_model="numpy", nogil=True)
def integrate(start, stop, z, p, relative, absolute, first_step, longest_step, limit, most_steps, sample_time, samples, counts, totals):
    """Integrate z' = rates(t, z, p) from start to stop; arguments and results are those of rodas5p."""
    new = np.empty(SIZE)
    stages = np.empty((7, SIZE))
    t = start
    h = first_step
    filled = 0
    accepted = 0
    rejected = 0
    after_rejection = False
    measured = totals.shape[0] > 0
    before = 0.0  # length of the step that led here
    status = FINISHED
    if samples.shape[0] > 0:
        for i in range(SIZE):
            samples[0, i] = z[i]
        filled = 1
    rates(t, z, p, stages[0])
    while t < stop:
        if accepted + rejected >= most_steps:
            status = TOO_MANY_STEPS
            break
        h = min(h, longest_step)
        last = t + h >= stop
        if last:
            h = stop - t
        dormand_step(t, h, z, p, stages, new)
        error = dormand_error(h, z, new, stages, relative, absolute)
        if error <= 1.0:
            filled = interpolate(t, h, z, new, stages, start, sample_time, samples, filled)
            if measured:
                observe(t, 0.5 * (before + h), z, p, totals)
                before = h
            t = stop if last else t + h
            accepted += 1
            largest = 0.0
            for i in range(SIZE):
                z[i] = new[i]
                stages[0, i] = stages[6, i]
                largest = max(largest, abs(new[i]))
            if largest > limit:
                status = DIVERGED
                break
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
