"""Motion with dry friction by SciPy's integrator, which stops where a row sticks or lets go."""

from dataclasses import dataclass
from itertools import product
from typing import Any, Protocol

import numpy as np
from scipy.integrate import solve_ivp


class System(Protocol):
    """States are positions, each with its velocity, row by row."""

    limits: np.ndarray  # (rows, 2): dry friction against positive and negative velocity

    def masses(self, x: np.ndarray, /) -> np.ndarray:
        """Mass matrix by row."""
        ...

    def forces(self, time: float, x: np.ndarray, /) -> np.ndarray:
        """Torque on each row but for dry friction."""
        ...


def accelerations(system: System, time: float, x: np.ndarray, modes: np.ndarray) -> np.ndarray:
    """Of each row, by the direction in which it slides; what sticks, mode 0, has none."""
    moves = modes != 0.0
    up, down = system.limits.T
    force = system.forces(time, x) - np.where(modes > 0.0, up, -down)
    found = np.zeros(len(modes))
    found[moves] = np.linalg.solve(system.masses(x)[np.ix_(moves, moves)], force[moves])
    return found


def holding(system: System, time: float, x: np.ndarray, modes: np.ndarray) -> np.ndarray:
    """What friction has to hold in each row that sticks."""
    return system.forces(time, x) - system.masses(x) @ accelerations(system, time, x, modes)


def first_modes(system: System, time: float, x: np.ndarray) -> np.ndarray:
    """Modes that contradict nothing: rows at rest stick or slide as their forces say."""
    free = [i for i, velocity in enumerate(x[1::2]) if abs(velocity) < 1e-10]
    modes = np.sign(x[1::2])
    up, down = (1.0 - 1e-9) * system.limits.T
    for trial in product((0.0, 1.0, -1.0), repeat=len(free)):
        modes[free] = trial
        pushed, held = accelerations(system, time, x, modes), holding(system, time, x, modes)
        stuck = modes == 0.0
        sticks = (held[stuck] <= up[stuck]) & (held[stuck] >= -down[stuck])
        if sticks.all() and all(modes[i] * pushed[i] >= -1e-9 for i in free if modes[i]):
            return modes
    raise AssertionError("no modes agree with the forces")


@dataclass
class Leaving:
    """How far a row is from where its mode ends; a run ends as it falls through zero."""

    system: System
    modes: np.ndarray
    row: int
    terminal = True
    direction = -1.0

    def __call__(self, time: float, x: np.ndarray) -> float:
        """A velocity, or what friction could hold beyond what it does."""
        mode = self.modes[self.row]
        if mode != 0.0:
            return mode * x[2 * self.row + 1]
        held, (up, down) = holding(self.system, time, x, self.modes), self.system.limits[self.row]
        return min(up - held[self.row], held[self.row] + down)


def motion(system: System, times: np.ndarray, start: np.ndarray) -> tuple[np.ndarray, int]:
    """States at some times from that at the first of them, and how often a mode ended."""
    now, x, found, ended = times[0], start.copy(), [start], 0
    while now < times[-1]:
        modes = first_modes(system, now, x)

        def rates(time: float, y: np.ndarray, modes: np.ndarray = modes) -> np.ndarray:
            velocities = np.where(modes == 0.0, 0.0, y[1::2])
            return np.column_stack((velocities, accelerations(system, time, y, modes))).ravel()

        exact: dict[str, Any] = {"method": "DOP853", "rtol": 1e-11, "atol": 1e-12}
        exact["events"] = [Leaving(system, modes, row) for row in range(len(modes))]
        run = solve_ivp(rates, (now, times[-1]), x, t_eval=times[times > now], **exact)
        found.extend(run.y.T if len(run.t) else ())
        if run.status == 0:
            break
        row = next(i for i, at in enumerate(run.t_events) if len(at))
        now, x, ended = float(run.t_events[row][0]), run.y_events[row][0].copy(), ended + 1
        if modes[row] != 0.0:
            x[2 * row + 1] = 0.0
    return np.array(found), ended
