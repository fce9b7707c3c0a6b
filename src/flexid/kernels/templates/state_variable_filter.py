# Template: needs sampled_parts, velocity_factors, N_ROWS, N_COEFFICIENTS, N_SIGNALS, HELD.


@njit(cache=True, error_model="numpy")
def filter_piece(
    positions, velocities, inputs, constants, sample_time, pole, zero_order, filtered, first
):
    """Double integrals of both sides of every row over two intervals, then smoothed twice.

    The second difference of a position is the integral of its acceleration over two intervals,
    weighted by a triangle. That integral is taken by a three-sample rule for every signal, and
    both sides pass the filter ((1 - pole) / (1 - pole/z))^2. Row i of `filtered` receives the
    regressor of coefficient i, row N_COEFFICIENTS + j the left-hand side of row j, known part
    subtracted, both from column `first` on.
    """
    factors = np.empty((N_SIGNALS, N_ROWS))
    velocity_factors(constants, factors)
    x = np.zeros(2 * N_ROWS)
    now = np.zeros(N_SIGNALS)  # at sample k, with the input from then on
    before = np.zeros(N_SIGNALS)  # the same at samples k - 1 and k - 2
    long_before = np.zeros(N_SIGNALS)
    end_now = np.zeros(N_SIGNALS)  # at sample k, with the input up to then
    end_before = np.zeros(N_SIGNALS)
    slope = np.empty(N_ROWS)
    signal = np.empty(N_SIGNALS)
    once = np.zeros(N_SIGNALS)
    twice = np.zeros(N_SIGNALS)
    gain = 1.0 - pole
    rate = 1.0 / sample_time
    for k in range(positions.shape[0]):
        for i in range(N_SIGNALS):
            long_before[i] = before[i]
            before[i] = now[i]
            end_before[i] = end_now[i]
        for j in range(N_ROWS):
            x[2 * j] = positions[k, j]
            x[2 * j + 1] = velocities[k, j]
        sampled_parts(x, inputs[k], constants, now)
        if zero_order and k > 0:
            sampled_parts(x, inputs[k - 1], constants, end_now)
        else:
            for i in range(N_SIGNALS):
                end_now[i] = now[i]
        if k < 2:
            continue
        for j in range(N_ROWS):
            slope[j] = 0.5 * rate * (positions[k, j] - positions[k - 2, j])
        for i in range(N_SIGNALS):
            if HELD[i]:  # linear over each interval, with a jump at the samples if need be
                inner = end_before[i] + before[i]
                value = (1.0 / 6.0) * (long_before[i] + 2.0 * inner + end_now[i])
            else:  # Numerov's rule: fourth order for a smooth signal
                value = (1.0 / 12.0) * (long_before[i] + 10.0 * before[i] + now[i])
            for j in range(N_ROWS):
                value += factors[i, j] * slope[j]
            signal[i] = value
        for j in range(N_ROWS):
            step = positions[k, j] - positions[k - 1, j]
            step_before = positions[k - 1, j] - positions[k - 2, j]
            known = signal[N_COEFFICIENTS + j]
            signal[N_COEFFICIENTS + j] = rate * rate * (step - step_before) - known
        for i in range(N_SIGNALS):
            once[i] = pole * once[i] + gain * signal[i]
            twice[i] = pole * twice[i] + gain * once[i]
            filtered[i, first + k - 2] = twice[i]
