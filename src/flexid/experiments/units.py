"""Units of what an experiment sets and a campaign keeps, where the model is the flexible joint."""

from flexid.errors import ExperimentError
from flexid.models.flexible_joint import COEFFICIENT_UNITS
from flexid.models.physical import physical_parameters
from flexid.toml_file import parse_toml

_TORQUE, _ANGLE, _VELOCITY, _TIME = "N m", "rad", "rad/s", "s"
_PARAMETERS = {p.name: p.unit for p in physical_parameters(COEFFICIENT_UNITS, input_is_torque=True)}
_COEFFICIENTS = {name: unit.format(input="(N m)") for name, unit in COEFFICIENT_UNITS.items()}
_STATES = {"x1": _ANGLE, "x2": _VELOCITY, "x3": _ANGLE, "x4": _VELOCITY}

_KEYS = {
    "model.coulomb_velocity": _VELOCITY,
    "run.duration": _TIME,
    "run.sample_time": _TIME,
    "sampling.sample_time": _TIME,
    "sampling.input_limit": _TORQUE,
    "sampling.position_resolution": _ANGLE,
    "sampling.position_noise": _ANGLE,
    "sampling.velocity_noise": _VELOCITY,
}
_GAINS = {
    "k": "1/s",
    "largest_link_inertia": "kg m^2",
    "largest_motor_inertia": "kg m^2",
    "smallest_joint_stiffness": "N m/rad",
    "proportional": "N m/rad",
    "derivative": "N m s/rad",
    "poles": "1/s",
}
_REFERENCE = {
    **dict.fromkeys(("amplitude", "amplitudes", "offset", "value", "phase", "phases"), _ANGLE),
    **dict.fromkeys(("angular_frequency", "angular_frequencies"), _VELOCITY),
}
_BLOCKS = {
    "plant": _PARAMETERS,
    "controller.nominal": _PARAMETERS,
    "initial_estimates": _COEFFICIENTS,
    "initial_state": _STATES,
}
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


class Units:
    """SI units by name; an empty text where flexid cannot know one."""

    def __init__(self, text: str) -> None:
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
        table, _, key = path.partition(".")
        if self._law and table in ("controller", "reference"):
            found = (_GAINS if table == "controller" else _REFERENCE).get(key.partition(".")[0])
            if found:
                return found
        block, _, name = path.rpartition(".")
        if path in _KEYS:
            timed = _KEYS[path] == _TIME
            return _KEYS[path] if self._joint or timed else ""
        return _BLOCKS.get(block, {}).get(name, "") if self._joint else ""

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
