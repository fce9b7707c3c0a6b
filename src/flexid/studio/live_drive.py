"""A simulated drive that runs on and on: samples in pieces, each from where the last one ended."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from flexid.arrays import FloatArray
from flexid.control.pd_gravity import pd_gravity
from flexid.control.references import Multisine
from flexid.models.flexible_joint import flexible_joint
from flexid.models.physical import lumped_coefficients
from flexid.simulation.loop import ClosedLoop
from flexid.simulation.sampled import Sampling, simulate_sampled
from flexid.streaming.options import WatchOptions

PIECE = 0.5
"""Seconds of a piece."""

TERMS = ("gravity", "motor_viscous")

DRIVE = {
    "gravity_torque": 5.0,
    "link_inertia": 1.0,
    "joint_stiffness": 100.0,
    "motor_inertia": 0.3,
    "motor_viscous_friction": 0.1,
}
"""Its parameters in SI units: those of Huang (2003), Table I."""

LOAD = 1.5
"""Times the link's inertia and weight, with a load."""

OPTIONS = WatchOptions(1e-3, TERMS, hold="zero")
"""How it is watched: its controller holds the torque between samples."""

_FREQUENCIES = (2.0, 5.0, 15.0)  # rad/s, as in experiments/sampled_joint.toml
_SAMPLING = Sampling(
    OPTIONS.sample_time,
    60.0,  # N m
    position_resolution=2 * np.pi / 65536,
    position_noise=1e-3,  # so much that one sees intervals become narrow
)


class SimulatedDrive:
    """A joint under a controller at 1 kHz that knows it roughly, with noisy encoders."""

    def __init__(self) -> None:
        self._loop = ClosedLoop(
            flexible_joint(TERMS, known={"beta1": 1 / DRIVE["motor_inertia"]}),
            _coefficients(DRIVE),
            pd_gravity(),
            _reference(0.0),
            {"link": 50.0, "motor": 50.0},
        )
        self._pieces = 0
        self._held: float | None = None

    def piece(self, *, loaded: bool, unplugged: bool) -> FloatArray:
        """Go on for `PIECE`.

        Parameters
        ----------
        loaded : bool
            Whether the link carries a load.
        unplugged : bool
            Whether the encoder of the link shows what it showed last; the controller, which
            does not look at it, goes on.

        Returns
        -------
        (n, 4) ndarray
            Time in s, link and motor in rad, torque in N m.
        """
        begun = self._pieces * PIECE
        loop = replace(
            self._loop,
            coefficients=_coefficients(truth(loaded=loaded)),
            reference=_reference(begun),
        )
        run = simulate_sampled(loop, PIECE, replace(_SAMPLING, seed=self._pieces))
        assert run.measured is not None
        self._loop = replace(loop, initial_state=run.states[-1])
        self._pieces += 1
        # The last sample is the first one of the next piece.
        link, motor = run.measured[:-1, 0], run.measured[:-1, 2]
        if unplugged:
            self._held = float(link[0]) if self._held is None else self._held
            link = np.full_like(link, self._held)
        else:
            self._held = None
        return np.column_stack((begun + run.time[:-1], link, motor, run.inputs[:-1, 0]))


def truth(*, loaded: bool) -> dict[str, float]:
    """The parameters of the drive, in SI units."""
    carried = {name: LOAD * DRIVE[name] for name in ("gravity_torque", "link_inertia")}
    return DRIVE | carried if loaded else DRIVE


def _coefficients(parameters: dict[str, float]) -> dict[str, float]:
    found = lumped_coefficients(**parameters)
    return {name: value for name, value in found.items() if name != "beta1"}


def _reference(begun: float) -> Multisine:
    """The motion that is asked for, from some time on."""
    phases = [w * begun for w in _FREQUENCIES]
    return Multisine((0.6, 0.3, 0.1), _FREQUENCIES, phases)
