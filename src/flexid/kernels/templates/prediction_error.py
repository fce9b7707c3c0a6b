# Template: needs variation_rates, N_STATES, N_INPUTS, N_COEFFICIENTS.

NODES = (0.0, 0.5, 0.5, 1.0)  # the classical Runge-Kutta method
WEIGHTS = (1.0 / 6.0, 2.0 / 6.0, 2.0 / 6.0, 1.0 / 6.0)
BOUND = 1e12  # a residual beyond it means that the segment diverged


@njit(cache=True, error_model="numpy")
def advance(z, first, change, p, c, at, h, substeps, rate, trial, total, u):
    """Bring z over one sampling interval, in place; the input runs from first by change."""
    step = h / substeps
    for s in range(substeps):
        total[:] = z
        trial[:] = z
        for stage in range(4):
            place = (s + NODES[stage]) / substeps
            for j in range(N_INPUTS):
                u[j] = first[j] + place * change[j]
            variation_rates(trial, u, p, c, at, rate)
            weight = step * WEIGHTS[stage]
            reach = step * NODES[min(stage + 1, 3)]
            for i in range(N_STATES):
                for j in range(z.shape[1]):
                    total[i, j] += weight * rate[i, j]
                    trial[i, j] = z[i, j] + reach * rate[i, j]
        z[:] = total


@njit(cache=True, error_model="numpy", nogil=True)
def segment_equations(
    first, stop, starts, lengths, first_blocks, sample_times, initial_states, measured, outputs,
    weights, inputs, p, c, wanted, held, substeps, normal, gradient, residuals, costs,
):
    """Normal equations of every block for its segment's initial state and the wanted coefficients.

    Of the segments from `first` up to, not including, `stop`: threads that have different ones do
    not meet. Segment s begins at sample starts[s], is made up of the blocks first_blocks[s] to
    first_blocks[s + 1] - 1, all of about the same length, and has the coefficients p[s], of which
    those at the places `wanted` are sought. Column a of `outputs` measures the state measured[a]
    and weighs weights[a] (one over its standard deviation). Fills `normal`, shape (n_blocks, n, n)
    with n = N_STATES + len(wanted), `gradient`, shape (n_blocks, n), all zero before, `residuals`,
    shape of `outputs`, and `costs`, shape (n_segments,), with the weighted sum of squares of each
    segment: infinite, and then the last one, if its motion diverged.
    """
    size = N_STATES + wanted.shape[0]
    at = np.zeros(N_COEFFICIENTS, np.int64)
    for j in range(wanted.shape[0]):
        at[wanted[j]] = 1 + N_STATES + j
    z = np.empty((N_STATES, 1 + size))
    rate = np.empty((N_STATES, 1 + size))
    trial = np.empty((N_STATES, 1 + size))
    total = np.empty((N_STATES, 1 + size))
    u = np.empty(N_INPUTS)
    change = np.zeros(N_INPUTS)
    for s in range(first, stop):
        cost = 0.0
        z[:] = 0.0
        for i in range(N_STATES):
            z[i, 0] = initial_states[s, i]
            z[i, 1 + i] = 1.0
        blocks = first_blocks[s + 1] - first_blocks[s]
        for k in range(starts[s], starts[s] + lengths[s]):
            b = first_blocks[s] + (k - starts[s]) * blocks // lengths[s]
            if k > starts[s]:
                if not held:
                    for j in range(N_INPUTS):
                        change[j] = inputs[k, j] - inputs[k - 1, j]
                advance(
                    z, inputs[k - 1], change, p[s], c, at, sample_times[s], substeps,
                    rate, trial, total, u,
                )
            for a in range(measured.shape[0]):
                row = z[measured[a]]
                residual = outputs[k, a] - row[0]
                if not abs(residual) < BOUND:
                    costs[s] = np.inf
                    return
                residuals[k, a] = residual
                square = weights[a] * weights[a]
                cost += square * residual * residual
                for j in range(size):
                    weighted = square * row[1 + j]
                    gradient[b, j] += weighted * residual
                    for l in range(j + 1):
                        normal[b, j, l] += weighted * row[1 + l]
        for b in range(first_blocks[s], first_blocks[s + 1]):
            for j in range(size):
                for l in range(j):
                    normal[b, l, j] = normal[b, j, l]
        costs[s] = cost
