"""Controllers as declarations: text expressions in states, reference and parameters.

The reference and its derivatives are called ``qd``, ``qd_1``, ``qd_2`` and so on, up to
`MAXIMUM_REFERENCE_ORDER`.
"""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

from flexid.errors import ModelError
from flexid.models.expression import evaluate

MAXIMUM_REFERENCE_ORDER = 4
"""Highest derivative of the reference that a controller may use."""

REFERENCE_NAMES = ("qd", *(f"qd_{order}" for order in range(1, MAXIMUM_REFERENCE_ORDER + 1)))
"""Names of the reference and its derivatives in a controller's expressions."""


@dataclass(frozen=True)
class Controller:
    """A static feedback law.

    Examples
    --------
    >>> proportional = Controller("P", "q", {"u": "stiffness*(qd - q)"}, {"stiffness": 10.0})
    >>> proportional.with_parameters(stiffness=20.0).parameters
    {'stiffness': 20.0}
    """

    name: str  # name of the law
    tracked: str  # the state that shall follow the reference
    # each input of the system, as a function of states, reference, parameters and definitions
    inputs: Mapping[str, str]
    # names and values; values can be replaced without a new derivation
    parameters: Mapping[str, float] = field(default_factory=dict)
    # auxiliary quantities in the order in which they are computed; each may use those before it.
    # Quantities that contain no state stay together in the derivation, and where the time
    # derivative of one is another, the derivation finds that out and cancels them.
    definitions: Mapping[str, str] = field(default_factory=dict)
    # coordinates in which the closed loop is well conditioned, one per state of the system and in
    # that order; each is its state plus something that depends on the states before it only, so
    # that the map can be inverted one by one. The plain states if left out.
    coordinates: Mapping[str, str] = field(default_factory=dict)
    # parameters that follow from the others, in the order in which they are computed; each may
    # use those before it. They are computed once for the values of a loop, not at every step.
    derived: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ("inputs", "definitions", "coordinates", "derived"):
            # A SymPy expression prints as text of the same grammar, so text is the stored form.
            texts = {key: str(value) for key, value in getattr(self, name).items()}
            object.__setattr__(self, name, texts)
        values = {key: float(value) for key, value in self.parameters.items()}
        object.__setattr__(self, "parameters", values)

    @cached_property
    def values(self) -> dict[str, float]:
        """All parameters by name, those that follow from others last."""
        values = dict(self.parameters)
        for name, text in self.derived.items():
            values[name] = evaluate(text, values, f"{self.name}: {name}")
        return values

    @cached_property
    def digest(self) -> str:
        """Hash of everything that a derivation depends on, which no parameter's value is."""
        content = [
            self.name,
            self.tracked,
            list(self.inputs.items()),
            [*self.parameters, *self.derived],
            list(self.definitions.items()),
            list(self.coordinates.items()),
        ]
        return hashlib.sha256(json.dumps(content).encode()).hexdigest()[:16]

    def with_parameters(self, **values: float) -> "Controller":
        """Return the same law with other values of some parameters."""
        for name in values:
            if name in self.derived:
                raise ModelError(
                    self.name,
                    f"computes {name} = {self.derived[name]} from its parameters: change those",
                )
            if name not in self.parameters:
                raise ModelError(
                    self.name,
                    f"has no parameter {name!r}; it has {', '.join(self.parameters) or 'none'}",
                )
        return replace(self, parameters={**self.parameters, **values})
