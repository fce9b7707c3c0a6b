"""PySINDy with a library of the acting terms, with smoothed derivatives or in weak form."""

import numpy as np
import pysindy

from benchmarks.rivals.given import Answer, Given

_SMOOTHED = 0.5  # rad of the resonance's phase, window of the smoothed differences
_WINDOWS, _HALF_WIDTH = 1000, 0.2  # of the weak form: number, and half-width in s
_THRESHOLD = 0.2  # of terms scaled to a root mean square of one; smaller coefficients are zero


def identify(log: Given, *, weak: bool) -> Answer:
    """Return the physical parameters of a joint, optionally by the weak form."""
    np.random.seed(0)  # noqa: NPY002 - PySINDy places its windows with NumPy's global generator
    h, time = log.sample_time, log.time
    rate = pysindy.SmoothedFiniteDifference(
        smoother_kws={"window_length": max(log.window(_SMOOTHED), 5), "polyorder": 3}
    )
    x1, x3 = log.positions.T
    v = np.column_stack([rate(q[:, None], time) for q in (x1, x3)])
    edges = np.append(time - 0.5 * h, time[-1] + 0.5 * h)
    candidates = {"spring": x1 - x3, "torque": log.mean_torque(edges)}
    if "gravity" in log.terms:
        candidates["gravity"] = np.sin(x1)
    for term, column in (("link_coulomb", 0), ("motor_coulomb", 1)):
        if term in log.terms:
            candidates[term] = np.sign(v[:, column])
    scales = np.array([np.sqrt(np.mean(c**2)) for c in candidates.values()])
    library = pysindy.PolynomialLibrary(degree=1, include_bias=False)
    if weak:
        library = pysindy.WeakPDELibrary(
            library, spatiotemporal_grid=time, K=_WINDOWS, H_xt=[_HALF_WIDTH]
        )
    model = pysindy.SINDy(
        pysindy.STLSQ(threshold=_THRESHOLD, alpha=0.0), library, differentiation_method=rate
    )
    model.fit(v, time, u=np.column_stack(list(candidates.values())) / scales)
    link, motor = (
        dict(zip(("link_speed", "motor_speed", *candidates), row, strict=True))
        for row in model.coefficients() / np.append([1.0, 1.0], scales)
    )
    motor_inertia = 1.0 / motor["torque"]
    stiffness = motor["spring"] * motor_inertia
    link_inertia = -stiffness / link["spring"]
    values = {
        "link_inertia": link_inertia,
        "motor_inertia": motor_inertia,
        "joint_stiffness": stiffness,
    }
    if "gravity" in candidates:
        values["gravity_torque"] = -link["gravity"] * link_inertia
    return Answer({name: float(value) for name, value in values.items()})
