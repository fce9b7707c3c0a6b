"""What an estimation beside a drive is given: the model, the clock, the filter, the memory."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from math import inf, isfinite
from typing import Any, Literal

from flexid.errors import SettingError
from flexid.estimators.filter_rate import check_filter_rate
from flexid.models.flexible_joint import TERMS, flexible_joint
from flexid.models.parametric_system import ParametricSystem
from flexid.models.rigid_joint import rigid_joint, rigid_terms
from flexid.models.terms import COULOMB_VELOCITY, check_terms
from flexid.recording.sampling import check_sample_time

USUAL_TERMS = ("gravity", "motor_viscous", "joint_damping", "motor_coulomb")
"""Terms of the model where none are named."""

RATES = (1.0, 0.25, 4.0)
"""Multiples of the filter rate that run side by side; the first is asked."""

_INPUT_UNITS = ("N m", "A", "V")


@dataclass(frozen=True)
class WatchOptions:
    """What does not change while a stream is watched.

    Parameters
    ----------
    sample_time : float
        In s.
    terms : tuple of str, optional
        Terms of the flexible joint beside its spring.
    kind : {"flexible", "rigid"}, optional
        Whether link and motor have an encoder each, or the drive has one.
    hold : {"auto", "linear", "zero"}, optional
        The input between samples: on straight lines, or held. With ``"auto"`` it is taken as on
        lines, and the intervals cover what a held one would give.
    filter_rate : float, optional
        λ of the filter, in 1/s.
    memory : float, optional
        Seconds after which a sample weighs 1/e as much; infinite: nothing fades.
    coulomb_velocity : float, optional
        Velocity in rad/s over which Coulomb friction changes its sign.
    input_unit : {"N m", "A", "V"}, optional
        Of what drives the motor.
    from_deflection : bool, optional
        Whether the link's position comes as the joint's deflection.

    Raises
    ------
    SettingError
        If one cannot be used.
    """

    sample_time: float
    terms: tuple[str, ...] = USUAL_TERMS
    kind: Literal["flexible", "rigid"] = "flexible"
    hold: Literal["auto", "linear", "zero"] = "auto"
    filter_rate: float = 20.0
    memory: float = inf
    coulomb_velocity: float = COULOMB_VELOCITY
    input_unit: str = "N m"
    from_deflection: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "terms", tuple(self.terms))
        check_sample_time(self.sample_time)
        check_terms(self.terms, TERMS)
        if self.kind not in ("flexible", "rigid"):
            raise SettingError("kind", f"{self.kind!r} is none: give 'flexible' or 'rigid'")
        if self.hold not in ("auto", "linear", "zero"):
            raise SettingError("hold", f"{self.hold!r} is none: give 'auto', 'linear' or 'zero'")
        check_filter_rate(
            self.filter_rate, self.sample_time, slowest=min(RATES), fastest=max(RATES)
        )
        if not self.memory > 20.0 / self.filter_rate:
            raise SettingError(
                "memory",
                f"{self.memory} s is shorter than the filter's own: give more than "
                f"{20.0 / self.filter_rate:.3g} s",
            )
        if self.input_unit not in _INPUT_UNITS:
            raise SettingError(
                "input unit", f"{self.input_unit!r} is none: give {', '.join(_INPUT_UNITS)}"
            )

    @property
    def system(self) -> ParametricSystem:
        """The model."""
        if self.kind == "rigid":
            terms = rigid_terms(self.terms)
            return rigid_joint(terms, coulomb_velocity=self.coulomb_velocity)
        return flexible_joint(self.terms, coulomb_velocity=self.coulomb_velocity)

    @property
    def document(self) -> dict[str, Any]:
        """The options, ready for JSON; an endless memory is None."""
        return {**asdict(self), "memory": self.memory if isfinite(self.memory) else None}

    @classmethod
    def of(cls, document: Mapping[str, Any]) -> "WatchOptions":
        """The options that a document holds.

        Raises
        ------
        SettingError
            If it holds none that can be used.
        """
        names = {f.name for f in fields(cls)}
        if not isinstance(document, Mapping) or {*document} != names:
            raise SettingError("checkpoint", "its options are not those of this version")
        memory = document["memory"]
        try:
            return cls(**{**document, "memory": inf if memory is None else memory})
        except (TypeError, ValueError):
            raise SettingError("checkpoint", "its options are of wrong types") from None
