@njit(cache=True, error_model="numpy")
def free_run(x0, u, p, c, h, held, substeps, out):
    """Integrate the model under a recorded input with the classical Runge-Kutta method.

    Between samples the input is held (held = 1) or interpolated linearly (held = 0).
    Returns the number of samples written: fewer than asked for if the motion diverged.
    """
    n = u.shape[0]
    x = x0.copy()
    xs = np.empty(N_STATES)
    us = np.empty(N_INPUTS)
    k1 = np.empty(N_STATES)
    k2 = np.empty(N_STATES)
    k3 = np.empty(N_STATES)
    k4 = np.empty(N_STATES)
    d = h / substeps
    out[0] = x
    for i in range(n - 1):
        slope = (1 - held) * (u[i + 1] - u[i]) / substeps
        for s in range(substeps):
            us[:] = u[i] + slope * s
            right_hand_side(x, us, p, c, k1)
            us[:] = u[i] + slope * (s + 0.5)
            xs[:] = x + 0.5 * d * k1
            right_hand_side(xs, us, p, c, k2)
            xs[:] = x + 0.5 * d * k2
            right_hand_side(xs, us, p, c, k3)
            us[:] = u[i] + slope * (s + 1.0)
            xs[:] = x + d * k3
            right_hand_side(xs, us, p, c, k4)
            x += d / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        if not np.all(np.abs(x) < 1e12):
            return i + 1
        out[i + 1] = x
    return n
