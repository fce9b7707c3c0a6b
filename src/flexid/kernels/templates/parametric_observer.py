# Template: needs advance, as_state, as_sample, as_settings, regressors and the sizes.


@njit(cache=True, error_model="numpy")
def step(state, sample, settings):
    """New state and innovation after one sample; the old state is left as it is."""
    new, innovation = advance(
        as_state(state), as_sample(sample.reshape((1, SAMPLE_SIZE)), 0), as_settings(settings)
    )
    new_state = np.empty(STATE_SIZE)
    for i in range(STATE_SIZE):
        new_state[i] = new[i]
    info = np.empty(N_ROWS)
    for j in range(N_ROWS):
        info[j] = innovation[j]
    return new_state, info


@njit(cache=True, error_model="numpy")
def replay(state, samples, settings, coefficients, innovations):
    """The same step over all samples; fills the history and returns the last state."""
    current = as_state(state)
    fixed = as_settings(settings)
    for n in range(samples.shape[0]):
        current, innovation = advance(current, as_sample(samples, n), fixed)
        for i in range(N_COEFFICIENTS):
            coefficients[n, i] = current[1 + i]
        for j in range(N_ROWS):
            innovations[n, j] = innovation[j]
    last = np.empty(STATE_SIZE)
    for i in range(STATE_SIZE):
        last[i] = current[i]
    return last


@njit(cache=True, error_model="numpy")
def mean_squares(samples, constants, squares):
    """Mean square of every regressor over the samples."""
    r = np.empty(N_COEFFICIENTS)
    k = np.empty(N_ROWS)
    squares[:] = 0.0
    for n in range(samples.shape[0]):
        regressors(samples[n, : 2 * N_ROWS], samples[n, 2 * N_ROWS :], constants, r, k)
        for i in range(N_COEFFICIENTS):
            squares[i] += r[i] * r[i]
    squares /= samples.shape[0]
