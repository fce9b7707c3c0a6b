# Template: needs right_hand_side, control, advance with its tuples, and the sizes.


@njit(cache=True, error_model="numpy")
def measure(x, noise, resolution, seen):
    """What the sensors show: every state with its noise, positions in whole encoder steps."""
    for i in range(N_STATES):
        seen[i] = x[i] + noise[i]
        if i % 2 == 0 and resolution > 0.0:
            seen[i] = resolution * np.floor(seen[i] / resolution + 0.5)


@njit(cache=True, error_model="numpy")
def saturate(u, limit):
    """Clip every input to the limit; return whether one was clipped."""
    clipped = False
    for i in range(N_INPUTS):
        if abs(u[i]) > limit:
            u[i] = copysign(limit, u[i])
            clipped = True
    return clipped


@njit(cache=True, error_model="numpy")
def move(x, u, p, c, duration, substeps):
    """Move the plant on under a constant input, with the classical Runge-Kutta method."""
    h = duration / substeps
    slope = np.empty(N_STATES)
    total = np.empty(N_STATES)
    trial = np.empty(N_STATES)
    for _ in range(substeps):
        for i in range(N_STATES):
            total[i] = 0.0
            trial[i] = x[i]
        for stage in range(4):
            right_hand_side(trial, u, p, c, slope)
            weight = 1.0 if stage == 0 or stage == 3 else 2.0
            ahead = h if stage == 2 else 0.5 * h
            for i in range(N_STATES):
                total[i] += weight * slope[i]
                trial[i] = x[i] + ahead * slope[i]
        for i in range(N_STATES):
            x[i] += h / 6.0 * total[i]


@njit(cache=True, error_model="numpy")
def bounded(x):
    """Whether every state is finite and of a size that means something."""
    for i in range(N_STATES):
        if not abs(x[i]) < 1e12:
            return False
    return True


@njit(cache=True, error_model="numpy")
def sampled_run(parameters, p, c, noise, resolution, limit, substeps, start_estimates, observer, states, inputs, measured, estimates):
    """Run the loop; states[0] holds the start. Return samples done and how many were clipped.

    observer holds the settings of the sampled observer, its sample time first.
    """
    h = observer[0]
    settings = as_settings(observer)
    empty = np.zeros(STATE_SIZE)
    for i in range(N_COEFFICIENTS):
        empty[1 + i] = start_estimates[i]
    current = as_state(empty)
    x = np.empty(N_STATES)
    for i in range(N_STATES):
        x[i] = states[0, i]
    sample = np.empty((1, SAMPLE_SIZE))
    clipped = 0
    for n in range(states.shape[0]):
        for i in range(N_STATES):
            states[n, i] = x[i]
        measure(x, noise[n], resolution, measured[n])
        control(n * h, measured[n], parameters, inputs[n])
        clipped += saturate(inputs[n], limit)
        for i in range(N_STATES):
            sample[0, i] = measured[n, i]
        for i in range(N_INPUTS):
            sample[0, N_STATES + i] = inputs[n, i]
        current, _ = advance(current, as_sample(sample, 0), settings)
        for i in range(N_COEFFICIENTS):
            estimates[n, i] = current[1 + i]
        move(x, inputs[n], p, c, h, substeps)
        if not bounded(x):
            return n + 1, clipped
    return states.shape[0], clipped
