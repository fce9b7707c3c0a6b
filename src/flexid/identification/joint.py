"""The two models that a log is held against: the flexible joint, and the rigid one.

Both are compiled once, with every term there is. A term that is off is a coefficient fixed at 0,
so that terms can be tried and dropped without a kernel of their own.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from flexid.errors import SettingError
from flexid.estimators.samples import Samples, rigid_samples, samples_of_recording
from flexid.estimators.unknowns import Unknowns
from flexid.models.flexible_joint import COEFFICIENT_UNITS, TERMS, flexible_joint
from flexid.models.parametric_system import ParametricSystem
from flexid.models.physical import PhysicalParameter, physical_parameters, rigid_parameters
from flexid.models.rigid_joint import RIGID_TERMS, RIGID_UNITS, rigid_joint
from flexid.models.terms import SMOOTHING
from flexid.recording.recording import Recording

FloatArray = NDArray[np.float64]

Kind = Literal["flexible", "rigid"]

SMOOTHED_FRICTION = frozenset({"motor_coulomb", "link_coulomb", "coulomb"})
"""Terms of friction that changes sign with the velocity, over `SMOOTHING`."""

DRY_FRICTION = SMOOTHED_FRICTION | {"motor_stiction"}
"""Terms of friction that does not grow with the velocity."""

_OFFSET_TERMS = ("link_offset", "motor_offset", "offset")


@dataclass(frozen=True)
class Joint:
    """A joint with all its terms; made by `flexible` and `rigid`.

    Parameters
    ----------
    kind : {"flexible", "rigid"}
        Two encoders and a spring between them, or one encoder.
    system : ParametricSystem
        The model with every term.
    terms : mapping of str to tuple of str
        Coefficients that each term adds.
    units : mapping of str to str
        Unit of every coefficient; ``{input}`` stands for the unit of the input.
    channels : tuple of str
        What a free run is compared in.
    """

    kind: Kind
    system: ParametricSystem
    terms: Mapping[str, tuple[str, ...]]
    units: Mapping[str, str]
    channels: tuple[str, ...]

    def with_coulomb_velocity(self, velocity: float) -> "Joint":
        """The same with another smoothing of Coulomb friction, in rad/s."""
        return replace(self, system=self.system.with_constants({SMOOTHING: velocity}))

    def samples(self, piece: Recording) -> Samples:
        """A piece as the estimators take it."""
        return samples_of_recording(piece) if self.kind == "flexible" else rigid_samples(piece)

    def outputs(self, piece: Recording) -> FloatArray:
        """Measured channels, shape (n, n_channels), in rad."""
        return self.channels_of(self.samples(piece).positions)

    def channels_of(self, positions: FloatArray) -> FloatArray:
        """Channels, shape (n, n_channels), from the positions of the rows, (n, n_rows), in rad."""
        if self.kind == "rigid":
            return positions
        return np.column_stack((positions, positions[:, 0] - positions[:, 1]))

    def unknowns(
        self,
        terms: Collection[str],
        fixed: Mapping[str, float],
        groups: Sequence[int] = (),
    ) -> Unknowns:
        """What is sought with some terms on.

        Parameters
        ----------
        terms : collection of str
            Those that are on; the spring, the inertias and the input's gain always are.
        fixed : mapping of str to float
            Coefficients whose value is given.
        groups : sequence of int, optional
            The log that each piece comes from: offsets are sought log by log.

        Raises
        ------
        SettingError
            If a given coefficient belongs to a term that is off, or nothing is left to seek.
        """
        off = [c for term, names in self.terms.items() if term not in terms for c in names]
        for name, value in fixed.items():
            if name in off and value != 0.0:
                (term,) = (t for t, names in self.terms.items() if name in names)
                raise SettingError(
                    "known", f"{name} belongs to the term {term!r}, which is off: switch it on"
                )
        offsets = [c for t in terms if t in _OFFSET_TERMS for c in self.terms[t] if c not in fixed]
        return Unknowns(
            self.system,
            {**dict.fromkeys(off, 0.0), **fixed},
            tuple(offsets),
            tuple(groups),
        )

    def terms_with(self, coefficients: Collection[str]) -> tuple[str, ...]:
        """Terms that some coefficients belong to, in the models' order."""
        return tuple(t for t, names in self.terms.items() if set(names) & set(coefficients))

    def parameters(
        self, coefficients: Collection[str], input_is_torque: bool
    ) -> tuple[PhysicalParameter, ...]:
        """Physical parameters that a set of coefficients determines."""
        if self.kind == "flexible":
            return physical_parameters(coefficients, input_is_torque)
        return rigid_parameters(coefficients, input_is_torque)


def flexible(friction: Literal["motor_coulomb", "motor_stiction"] = "motor_coulomb") -> Joint:
    """The flexible joint of Huang (2003), eq. (4), with every further term.

    Parameters
    ----------
    friction : {"motor_coulomb", "motor_stiction"}, optional
        Which of the two models of the motor's dry friction there is; they share a coefficient.
    """
    other = {"motor_coulomb", "motor_stiction"} - {friction}
    terms = {name: term for name, term in TERMS.items() if name not in other}
    return Joint(
        "flexible",
        flexible_joint(tuple(terms)),
        {name: (*term.link, *term.motor) for name, term in terms.items()},
        COEFFICIENT_UNITS,
        ("link_position", "motor_position", "deflection"),
    )


def rigid() -> Joint:
    """The rigid joint with every term."""
    return Joint(
        "rigid",
        rigid_joint(tuple(RIGID_TERMS)),
        {name: tuple(regressors) for name, regressors in RIGID_TERMS.items()},
        RIGID_UNITS,
        ("motor_position",),
    )
