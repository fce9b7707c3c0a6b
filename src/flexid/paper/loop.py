"""Declaration of a closed loop, and references with exact derivatives of any order."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexid.errors import ModelError
from flexid.models.expression import check_expression
from flexid.models.parametric_system import RESERVED, ParametricSystem, check_name
from flexid.paper.laws import REFERENCE_NAMES, Controller


@dataclass(frozen=True)
class Multisine:
    """Reference q_d(t) = offset + Σ amplitude_i sin(angular_frequency_i t + phase_i)."""

    amplitudes: Sequence[float]  # in rad, or the unit of the tracked coordinate
    angular_frequencies: Sequence[float]  # in rad/s, one per amplitude
    phases: Sequence[float] = ()  # in rad, one per amplitude; all zero if left out
    offset: float = 0.0  # in the unit of the amplitudes

    def __post_init__(self) -> None:
        for name in ("amplitudes", "angular_frequencies"):
            object.__setattr__(self, name, tuple(float(v) for v in getattr(self, name)))
        phases = self.phases or (0.0,) * len(self.amplitudes)
        object.__setattr__(self, "phases", tuple(float(v) for v in phases))
        if not len(self.amplitudes) == len(self.angular_frequencies) == len(self.phases):
            raise ModelError(
                "multisine",
                f"has {len(self.amplitudes)} amplitudes, {len(self.angular_frequencies)} angular "
                f"frequencies and {len(self.phases)} phases: give as many of each",
            )

    @property
    def expression(self) -> str:
        """Reference q_d as a text expression in ``t`` and the parameters' names."""
        places = range(1, len(self.amplitudes) + 1)
        waves = (f"qd_amplitude{i}*sin(qd_frequency{i}*t + qd_phase{i})" for i in places)
        return " + ".join(["qd_offset", *waves])

    @property
    def parameters(self) -> dict[str, float]:
        """Names and values of the parameters."""
        values = {"qd_offset": float(self.offset)}
        waves = zip(self.amplitudes, self.angular_frequencies, self.phases, strict=True)
        for i, (amplitude, frequency, phase) in enumerate(waves, start=1):
            values[f"qd_amplitude{i}"] = amplitude
            values[f"qd_frequency{i}"] = frequency
            values[f"qd_phase{i}"] = phase
        return values

    @property
    def digest(self) -> str:
        """Hash of what a derivation depends on: expression and names, but no values."""
        content = "\0".join((self.expression, *self.parameters))
        return hashlib.sha256(content.encode()).hexdigest()[:16]

    def evaluate(self, time: ArrayLike, order: int = 0) -> NDArray[np.float64]:
        """Return the derivative of the given order at each time in s."""
        time = np.asarray(time, dtype=float)
        value = np.full(time.shape, self.offset if order == 0 else 0.0)
        waves = zip(self.amplitudes, self.angular_frequencies, self.phases, strict=True)
        for amplitude, frequency, phase in waves:
            # Each derivative shifts a sine by a quarter period, which sin and cos give exactly.
            wave = np.cos if order % 2 else np.sin
            sign = -1.0 if order % 4 >= 2 else 1.0
            value += sign * amplitude * frequency**order * wave(frequency * time + phase)
        return value


def sinusoid(
    amplitude: float, angular_frequency: float, phase: float = 0.0, offset: float = 0.0
) -> Multisine:
    """Return one sine wave, the reference of Huang (2003), section 5; units as in `Multisine`."""
    return Multisine((amplitude,), (angular_frequency,), (phase,), offset)


def constant(value: float) -> Multisine:
    """Return a constant reference."""
    return Multisine((), (), (), value)


@dataclass(frozen=True)
class LoopDeclaration:
    """System, controller and reference of a closed loop, checked for consistency."""

    system: ParametricSystem
    controller: Controller
    reference: Multisine

    def __post_init__(self) -> None:
        self._check_shape()
        self._check_names()
        self._check_expressions()

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of a compiled loop's run-time parameters, in order, the observer's gains last."""
        return (
            *self.system.coefficients,
            *self.system.constants,
            *self.controller.parameters,
            *self.controller.derived,
            *self.reference.parameters,
            *(f"_gain{place}" for place in range(len(self.system.rows))),
        )

    @property
    def coordinates(self) -> dict[str, str]:
        """Coordinates of the controller, or the plain states if it has none."""
        return dict(self.controller.coordinates) or {x: x for x in self.system.states}

    @property
    def digests(self) -> tuple[str, ...]:
        """Hashes of the three declarations."""
        return self.system.digest, self.controller.digest, self.reference.digest

    def _check_shape(self) -> None:
        name, system, controller = self.controller.name, self.system, self.controller
        if set(controller.inputs) != set(system.inputs):
            raise ModelError(
                name,
                f"gives the inputs {', '.join(controller.inputs)}, but {system.name!r} has "
                f"{', '.join(system.inputs)}: give one expression for each",
            )
        if controller.tracked not in system.states:
            raise ModelError(name, f"tracks {controller.tracked!r}, no state of {system.name!r}")
        if len(self.coordinates) != len(system.states):
            raise ModelError(
                name, f"has {len(self.coordinates)} coordinates for {len(system.states)} states"
            )

    def _check_names(self) -> None:
        system, controller = self.system, self.controller
        own = [*controller.parameters, *controller.derived, *controller.definitions]
        own += self.reference.parameters
        own += [name for name in controller.coordinates if name not in system.states]
        taken = {*system.states, *system.inputs, *system.constants, *system.coefficients}
        taken |= {*REFERENCE_NAMES, *RESERVED}
        for place, name in enumerate(own):
            check_name(controller.name, name)
            if name in taken or name in own[:place]:
                raise ModelError(
                    controller.name,
                    f"the name {name!r} has another meaning in the loop: choose another",
                )

    def _check_expressions(self) -> None:
        controller = self.controller
        names = frozenset(controller.parameters)
        for name, text in controller.derived.items():
            check_expression(text, names, f"{controller.name}: {name}")
            names |= {name}
        names |= {*self.system.states, *self.system.constants, *REFERENCE_NAMES}
        for name, text in controller.definitions.items():
            check_expression(text, names, f"{controller.name}: {name}")
            names |= {name}
        for name, text in {**controller.inputs, **controller.coordinates}.items():
            check_expression(text, names, f"{controller.name}: {name}")
        known = frozenset({"t", *self.reference.parameters})
        check_expression(self.reference.expression, known, "reference")
