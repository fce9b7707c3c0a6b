"""Units of what an experiment sets and a campaign keeps, where the model is the flexible joint."""

from typing import Any, get_args

from flexid.errors import ExperimentError
from flexid.experiments.tables import (
    ContinuousRun,
    JointModel,
    Law,
    Reference,
    SamplingTable,
    Table,
)
from flexid.models.flexible_joint import COEFFICIENT_UNITS
from flexid.models.physical import physical_parameters
from flexid.toml_file import parse_toml

_TORQUE, _ANGLE, _VELOCITY, _TIME = "N m", "rad", "rad/s", "s"
_PARAMETERS = {p.name: p.unit for p in physical_parameters(COEFFICIENT_UNITS, input_is_torque=True)}
_COEFFICIENTS = {name: unit.format(input="(N m)") for name, unit in COEFFICIENT_UNITS.items()}
_STATES = {"x1": _ANGLE, "x2": _VELOCITY, "x3": _ANGLE, "x4": _VELOCITY}
_RESULTS = {
    "reached": _TIME,
    "steps": "1",
    "tracking_rms": _ANGLE,
    "tracking_peak": _ANGLE,
    "relative_error": "1",
    "excitation": "1",  # condition numbers
    "settling_time": _TIME,
    "peak_input": _TORQUE,
}


def _declared(path: str, *kinds: type[Table]) -> dict[str, str]:
    """Units of the fields of tables, by dotted path."""
    units: dict[str, str] = {}
    for kind in kinds:
        for name, field in kind.model_fields.items():
            here = f"{path}.{name}"
            for unit in field.metadata:
                if isinstance(unit, str):
                    units[here] = unit
            if isinstance(field.annotation, type) and issubclass(field.annotation, Table):
                units |= _declared(here, field.annotation)
    return units


_SET: dict[str, str] = {
    **_declared("model", JointModel),
    **_declared("controller", *get_args(Law)),
    **_declared("reference", *get_args(Reference)),
    **_declared("run", ContinuousRun),
    **_declared("sampling", SamplingTable),
    **{f"plant.{name}": unit for name, unit in _PARAMETERS.items()},
    **{f"controller.nominal.{name}": unit for name, unit in _PARAMETERS.items()},
    **{f"initial_estimates.{name}": unit for name, unit in _COEFFICIENTS.items()},
    **{f"initial_state.{name}": unit for name, unit in _STATES.items()},
}


class Units:
    """SI units by name, of the experiment file with this text; empty where none can be known."""

    def __init__(self, text: str) -> None:
        tables: dict[str, Any]
        try:
            tables = parse_toml(text.encode(), lambda key, reason: ExperimentError("", key, reason))
        except ExperimentError:
            tables = {"model": {"file": ""}}
        model, controller = tables.get("model"), tables.get("controller")
        self._joint = not (isinstance(model, dict) and "file" in model)
        own_law = isinstance(controller, dict) and controller.get("law") == "expressions"
        # The user's own law decides what its parameters are, and what follows the reference.
        self._law = self._joint and not own_law

    def of_value(self, path: str) -> str:
        """Unit of the number at a dotted path, such as ``plant.link_inertia``."""
        whole, _, place = path.rpartition(".")
        unit = _SET.get(whole if place.isdecimal() else path, "")
        following = path.startswith(("controller.", "reference."))
        known = self._law if following else self._joint
        return unit if known or unit == _TIME else ""

    def of_result(self, name: str) -> str:
        """Unit of a result that a campaign keeps, such as ``final_error.theta1``."""
        prefix, _, rest = name.partition(".")
        if prefix.startswith("tracking"):
            return _RESULTS[prefix] if self._law else ""
        if prefix == "final_error":
            return _COEFFICIENTS.get(rest, "") if self._joint else ""
        if prefix == "final_state":
            return _STATES.get(rest, "") if self._joint else ""
        unit = _RESULTS.get(prefix, "")
        return unit if self._joint or unit in (_TIME, "1") else ""
