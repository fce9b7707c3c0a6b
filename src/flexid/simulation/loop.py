"""A closed loop with all its values: what a simulation starts from."""

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexid.control.controller import Controller
from flexid.control.loop import LoopDeclaration
from flexid.control.references import Reference
from flexid.errors import SettingError, did_you_mean
from flexid.models.parametric_system import ParametricSystem


@dataclass(frozen=True)
class ClosedLoop:
    """System, controller, reference and parametric observer, with values."""

    # the model of plant and observer; its constants have the values declared in it
    system: ParametricSystem
    coefficients: Mapping[str, float]  # the true coefficients
    controller: Controller
    reference: Reference
    observer_gains: Mapping[str, float]  # the observer's gain c for each row, by the row's name
    # p̂ at the start; 0 for those left out
    initial_estimates: Mapping[str, float] = field(default_factory=dict)
    # x at the start, in the order of system.states; all 0 if left out
    initial_state: Sequence[float] = ()

    def __post_init__(self) -> None:
        rows = tuple(row.name for row in self.system.rows)
        check_values("coefficients", self.coefficients, self.system.coefficients)
        check_values("observer_gains", self.observer_gains, rows)
        check_values("initial_estimates", self.initial_estimates, self.system.coefficients, False)
        state = tuple(map(float, self.initial_state)) or (0.0,) * len(self.system.states)
        if len(state) != len(self.system.states):
            raise SettingError(
                "initial_state", f"has {len(state)} values for {len(self.system.states)} states"
            )
        object.__setattr__(self, "initial_state", state)
        self.declaration  # noqa: B018 - checks that the parts fit together

    @cached_property
    def declaration(self) -> LoopDeclaration:
        """The loop without its values."""
        return LoopDeclaration(self.system, self.controller, self.reference)

    def with_values(self, **values: Any) -> "ClosedLoop":
        """Return the same loop with other values of some fields; the two share one declaration.

        What only the names decide is not checked again, so that a loop costs some microseconds
        where thousands differ in their values alone.
        """
        changed = copy(self)  # with its declaration
        for name, value in values.items():
            object.__setattr__(changed, name, value)
        if changed._names() != self._names():
            raise SettingError("with_values", "other names than this loop's: build a new loop")
        return changed

    def _names(self) -> tuple[object, ...]:
        """What is decided by names alone."""
        tables = (self.system.constants, self.coefficients, self.observer_gains)
        return (
            *map(tuple, (*tables, self.initial_estimates, self.reference.parameters)),
            len(self.initial_state),
            self.controller.digest,
            self.reference.expression,
        )

    @property
    def true_coefficients(self) -> NDArray[np.float64]:
        """p, in the system's order."""
        return np.array([self.coefficients[name] for name in self.system.coefficients])

    @property
    def start_estimates(self) -> NDArray[np.float64]:
        """p̂ at the start, in the system's order."""
        return np.array([self.initial_estimates.get(p, 0.0) for p in self.system.coefficients])

    @property
    def parameters(self) -> NDArray[np.float64]:
        """Run-time parameters of the compiled loop, in the declaration's order."""
        gains = [self.observer_gains[row.name] for row in self.system.rows]
        values = (
            *self.true_coefficients,
            *self.system.constants.values(),
            *self.controller.values.values(),
            *self.reference.parameters.values(),
            *gains,
        )
        return np.array(values, dtype=float)


def check_values(
    setting: str, values: Mapping[str, float], names: tuple[str, ...], complete: bool = True
) -> None:
    """Raise `SettingError` for a value of an unknown name, or if one is missing."""
    for name in values:
        if name not in names:
            raise SettingError(setting, f"{name!r} is unknown{did_you_mean(name, names)}")
    missing = [name for name in names if name not in values]
    if complete and missing:
        raise SettingError(setting, f"{', '.join(missing)} missing: give a value for each")
