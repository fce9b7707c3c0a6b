"""The declaration of a closed loop: what a derivation needs to know, without any values."""

from dataclasses import dataclass

from flexid.control.laws import REFERENCE_NAMES, Controller
from flexid.control.references import Multisine
from flexid.errors import ModelError
from flexid.models.expression import check_expression
from flexid.models.parametric_system import RESERVED, ParametricSystem, check_name


@dataclass(frozen=True)
class LoopDeclaration:
    """System, controller and reference that fit together."""

    system: ParametricSystem
    controller: Controller
    reference: Multisine

    def __post_init__(self) -> None:
        self._check_shape()
        self._check_names()
        self._check_expressions()

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Order of the run-time parameters of a compiled loop, the observer's gains last."""
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
        """The controller's coordinates, or the plain states."""
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
