# Template: needs advance, as_state, as_sample, as_settings, regressors, is_finite and the sizes.


@njit(cache=True, error_model="numpy")
def take(current, samples, n, fixed, info):
    """State after sample n, as a tuple; info receives innovations and a status."""
    if not is_finite(samples[n]):
        for j in range(N_ROWS):
            info[j] = np.nan
        info[N_ROWS] = REJECTED
        return (0.0,) + current[1:]
    info[N_ROWS] = STARTING  # a constant gain cannot know whether the data tell the coefficients
    current, innovation = advance(current, as_sample(samples, n), fixed)
    for j in range(N_ROWS):
        info[j] = innovation[j]
    return current


@njit(cache=True, error_model="numpy")
def as_array(current):
    """The state as an array again."""
    state = np.empty(STATE_SIZE)
    for i in range(STATE_SIZE):
        state[i] = current[i]
    return state


@njit(cache=True, error_model="numpy")
def step(state, sample, settings):
    """New state and info after one sample; the old state is left as it is."""
    info = np.empty(N_ROWS + 1)
    one = sample.reshape((1, SAMPLE_SIZE))
    return as_array(take(as_state(state), one, 0, as_settings(settings), info)), info


@njit(cache=True, error_model="numpy")
def replay(state, samples, settings, coefficients, infos):
    """The same step over all samples; fills the history and returns the last state."""
    current = as_state(state)
    fixed = as_settings(settings)
    for n in range(samples.shape[0]):
        current = take(current, samples, n, fixed, infos[n])
        for i in range(N_COEFFICIENTS):
            coefficients[n, i] = current[1 + i]
    return as_array(current)


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
