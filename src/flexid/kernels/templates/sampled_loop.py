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
    k1 = np.empty(N_STATES)
    k2 = np.empty(N_STATES)
    k3 = np.empty(N_STATES)
    k4 = np.empty(N_STATES)
    h = duration / substeps
    for _ in range(substeps):
        right_hand_side(x, u, p, c, k1)
        right_hand_side(x + 0.5 * h * k1, u, p, c, k2)
        right_hand_side(x + 0.5 * h * k2, u, p, c, k3)
        right_hand_side(x + h * k3, u, p, c, k4)
        for i in range(N_STATES):
            x[i] += h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i])


@njit(cache=True, error_model="numpy")
def sampled_run(parameters, p, c, noise, resolution, limit, substeps, start_estimates, observer, states, inputs, measured, estimates):
    """Run the loop; states[0] holds the start. Return samples done and how many were clipped.

    observer holds the settings of the sampled observer, its sample time first.
    """
    h = observer[0]
    settings = as_settings(observer)
    empty = np.zeros(STATE_SIZE)
    empty[1 : 1 + N_COEFFICIENTS] = start_estimates
    current = as_state(empty)
    x = states[0].copy()
    sample = np.empty((1, SAMPLE_SIZE))
    clipped = 0
    for n in range(states.shape[0]):
        states[n] = x
        measure(x, noise[n], resolution, measured[n])
        control(n * h, measured[n], parameters, inputs[n])
        clipped += saturate(inputs[n], limit)
        sample[0, :N_STATES] = measured[n]
        sample[0, N_STATES:] = inputs[n]
        current, _ = advance(current, as_sample(sample, 0), settings)
        for i in range(N_COEFFICIENTS):
            estimates[n, i] = current[1 + i]
        move(x, inputs[n], p, c, h, substeps)
        if not np.all(np.abs(x) < 1e12):
            return n + 1, clipped
    return states.shape[0], clipped
