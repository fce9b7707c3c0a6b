"""CasADi, multiple shooting: all states are unknowns, constrained by the model; IPOPT solves.

As in CasADi's own example of system identification, every sample is a node, the states start from
the measurements, and the Hessian is of Gauss-Newton type. Velocities without a sensor start from
differences of smoothed positions. There are no intervals.
"""

import casadi as ca
import numpy as np
from scipy.signal import savgol_filter

from benchmarks.peers.problem import COEFFICIENTS, Answer, Log


class NotSolvedError(Exception):
    """IPOPT did not find a solution."""


def identify(log: Log) -> Answer:
    # user code begins
    h, n = log.sample_time, len(log.time)
    guess = np.array([log.guess[name] for name in COEFFICIENTS])
    x, parameters, torques = ca.SX.sym("x", 4), ca.SX.sym("p", 5), ca.SX.sym("u", 2)
    theta1, theta2, alpha1, alpha2, beta1 = ca.vertsplit(parameters * guess)

    def rates(x, torque):
        link = -theta1 * ca.sin(x[0]) - theta2 * (x[0] - x[2])
        motor = alpha1 * (x[0] - x[2]) - alpha2 * x[3] + beta1 * torque
        return ca.vertcat(x[1], link, x[3], motor)

    middle = 0.5 * (torques[0] + torques[1])
    k1 = rates(x, torques[0])
    k2 = rates(x + 0.5 * h * k1, middle)
    k3 = rates(x + 0.5 * h * k2, middle)
    k4 = rates(x + h * k3, torques[1])
    sample = ca.Function(
        "sample", [x, torques, parameters], [x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)]
    )

    smooth = np.array([savgol_filter(q, 41, 3, deriv=1, delta=h) for q in log.positions.T])
    velocities = smooth if log.velocities is None else log.velocities.T
    (x1, x3), (x2, x4) = log.positions.T, velocities
    measured, noise = np.array([x1, x2, x3, x4]), np.array([log.position_noise, 1.0] * 2)
    if log.velocities is not None:
        noise[1::2] = log.velocity_noise
    scaled = ca.MX.sym("z", 4, n)  # states less measurements
    scale = np.array([log.position_noise, 1e2 * log.position_noise] * 2)
    states = measured + ca.repmat(scale, 1, n) * scaled
    last = log.torque[:-1] if log.held else log.torque[1:]
    unknown = ca.MX.sym("q", 5)
    ends = sample.map(n - 1)(states[:, :-1], np.array([log.torque[:-1], last]), unknown)
    gaps = (ends - states[:, 1:]) / ca.repmat(scale, 1, n - 1)
    rows = [0, 2] if log.velocities is None else [0, 1, 2, 3]
    misfit = ca.vec(scaled[rows, :] * ca.repmat((scale / noise)[rows], 1, n))
    variables = ca.veccat(unknown, scaled)
    factor = ca.MX.sym("factor")
    J = ca.jacobian(misfit, variables)
    hessian = ca.Function(
        "hessian",
        [variables, ca.MX.sym("none", 0), factor, ca.MX.sym("multipliers", 4 * (n - 1))],
        [factor * ca.triu(J.T @ J)],
        ["x", "p", "lam_f", "lam_g"],
        ["triu_hess_gamma_x_x"],
    )
    problem = {"x": variables, "f": 0.5 * ca.sumsqr(misfit), "g": ca.vec(gaps)}
    options = {"hess_lag": hessian, "print_time": False, "ipopt": {"print_level": 0}}
    solver = ca.nlpsol("solver", "ipopt", problem, options)
    start = ca.vertcat(np.ones(5), np.zeros(4 * n))
    solution = solver(x0=start, lbg=0.0, ubg=0.0)
    # user code ends
    if not solver.stats()["success"]:
        raise NotSolvedError(solver.stats()["return_status"])
    values = np.array(solution["x"][:5]).ravel() * guess
    return Answer(dict(zip(COEFFICIENTS, values.tolist(), strict=True)))
