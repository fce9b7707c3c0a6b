# Template: needs sampled_parts, velocity_factors, N_ROWS, N_COEFFICIENTS, N_SIGNALS, ROW_START, HELD.


@njit(cache=True, error_model="numpy")
def filter_piece(positions, velocities, inputs, constants, sample_time, pole, zero_order, filtered):
    """Double integrals of both sides of every row over two intervals, then smoothed twice.

    The second difference of a position is the integral of its acceleration over two intervals,
    weighted by a triangle. That integral is taken by a three-sample rule for every signal, and
    both sides pass the filter ((1 - pole) / (1 - pole/z))^2. Row i of `filtered` receives the
    regressor of coefficient i, row N_COEFFICIENTS + j the left-hand side of row j, known part
    subtracted.
    """
    n = positions.shape[0]
    factors = np.empty((N_SIGNALS, N_ROWS))
    velocity_factors(constants, factors)
    x = np.zeros(2 * N_ROWS)
    start = np.zeros((3, N_SIGNALS))  # at samples k - 2, k - 1, k, with the input from then on
    end = np.zeros((2, N_SIGNALS))  # at samples k - 1, k, with the input up to then
    signal = np.empty(N_SIGNALS)
    once = np.zeros(N_COEFFICIENTS + N_ROWS)
    twice = np.zeros(N_COEFFICIENTS + N_ROWS)
    gain = 1.0 - pole
    for k in range(n):
        for i in range(N_SIGNALS):
            start[0, i], start[1, i] = start[1, i], start[2, i]
            end[0, i] = end[1, i]
        for j in range(N_ROWS):
            x[2 * j] = positions[k, j]
            x[2 * j + 1] = velocities[k, j]
        sampled_parts(x, inputs[k], constants, start[2])
        if zero_order and k > 0:
            sampled_parts(x, inputs[k - 1], constants, end[1])
        else:
            end[1] = start[2]
        if k < 2:
            continue
        for i in range(N_SIGNALS):
            if HELD[i]:  # linear over each interval, with a jump at the samples if need be
                inner = end[0, i] + start[1, i]
                value = (start[0, i] + 2.0 * inner + end[1, i]) / 6.0
            else:  # Numerov's rule: fourth order for a smooth signal
                value = (start[0, i] + 10.0 * start[1, i] + start[2, i]) / 12.0
            for j in range(N_ROWS):
                slope = (positions[k, j] - positions[k - 2, j]) / (2.0 * sample_time)
                value += factors[i, j] * slope
            signal[i] = value
        for j in range(N_ROWS):
            bend = (positions[k, j] - positions[k - 1, j]) - (
                positions[k - 1, j] - positions[k - 2, j]
            )
            signal[N_COEFFICIENTS + j] = bend / sample_time**2 - signal[N_COEFFICIENTS + j]
        for i in range(N_COEFFICIENTS + N_ROWS):
            once[i] = pole * once[i] + gain * signal[i]
            twice[i] = pole * twice[i] + gain * once[i]
            filtered[i, k - 2] = twice[i]
