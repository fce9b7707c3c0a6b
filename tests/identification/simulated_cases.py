"""Cases of simulated logs, and the check that an identification finds what acts in them."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import pytest
from made_joint import TRUTH, log, made

from flexid.identification.identify import identify
from flexid.identification.preparation.settings import Settings
from flexid.identification.result import Identification
from flexid.models.flexible_joint import PAPER_TERMS

LINK_TRUTH = {"joint_stiffness_per_link_inertia": 100.0, "gravity_torque_per_link_inertia": 5.0}

FOUND_AS = {
    "motor_coulomb_up": "motor_coulomb_friction",
    "link_coulomb": "link_coulomb_friction",
    "motor_static": "motor_stribeck_friction",
    "bristle_coulomb": "presliding_friction",
    "cubic_stiffness": "cubic_joint_stiffness",
    "half_gap": "half_backlash",
    "contact_damping": "joint_damping",
    "bend": "bend_deflection",
    "hysteresis_torque": "spring_hysteresis",
    "ripple_torque": "torque_ripple",
    "ripple_phase": "ripple_angle",
    "eccentricity_phase": "eccentricity_angle",
    "transmission_number": "error_number",
    "transmission_phase": "transmission_error_angle",
    "second_transmission_phase": "second_transmission_error_angle",
}
"""Parameters that an identification reports under another name than the simulation's."""

NOT_REPORTED = {"held", "noise", "motor_coulomb_down", "stribeck_exponent", "bristle_static"}
NOT_REPORTED |= {"bristle_stiffness", "saturation", "peak_torque", "torque_noise"}
NOT_REPORTED |= {"size", "motor_scale"}

DRY: dict[str, Any] = {"motor_coulomb_up": 1.0, "motor_coulomb_down": 1.0}
STICTION: dict[str, Any] = {"motor_static": 0.6, "stribeck_velocity": 0.15}
RIPPLED: dict[str, Any] = {"ripple_torque": 0.3, "ripple_number": 23.4, "ripple_phase": 0.8}
BENT: dict[str, Any] = {"bend": 0.3, "bend_stiffness": 40.0}
HYSTERESIS: dict[str, Any] = {"hysteresis_torque": 0.5, "hysteresis_reach": 0.03}
BRISTLES: dict[str, Any] = {
    "bristle_coulomb": 2.0,
    "bristle_static": 2.0,
    "bristle_stiffness": 400.0,
}
SLID = {"motor_coulomb_friction": 2.0, "presliding_reach": 0.005}
"""Values of these bristles beside the presliding friction."""


def asked(*terms: str) -> Settings:
    """Return settings that ask for these terms and the paper's."""
    return Settings(terms=(*PAPER_TERMS, *terms))


@dataclass(frozen=True)
class Case:
    """Settings of simulated logs, and what an identification should find."""

    acts: Mapping[str, Any] = field(default_factory=dict)
    terms: tuple[str, ...] = ()  # in addition to the paper's
    values: Mapping[str, float] = field(default_factory=dict)  # in addition to those that act
    settings: Settings = field(default_factory=Settings)
    seconds: Mapping[int, float] = field(default_factory=lambda: {1: 8.0})  # duration by seed
    accuracy: float = 1e-4  # relative, of all values
    rough: str = ""  # a value that the log shows less accurately
    hold: str = "cubic"
    shapes: Mapping[str, Any] = field(default_factory=dict)

    def identified(self) -> Identification:
        """Return the result for the logs."""
        logs = [log(made(seed, duration, **self.acts)) for seed, duration in self.seconds.items()]
        return identify(logs, self.settings)

    def truth(self, *, alone: bool) -> dict[str, float]:
        """Return the true values by the names of the result, or of the link alone."""
        found = dict(LINK_TRUTH if alone else TRUTH)
        for name, value in self.acts.items():
            if name in NOT_REPORTED or (alone and name.startswith("motor")):
                continue
            ratio = "_per_link_inertia" if alone and name.endswith("stiffness") else ""
            sign = -1.0 if name.endswith("_phase") else 1.0
            found[FOUND_AS.get(name, name) + ratio] = sign * value
        return {
            name: value for name, value in {**found, **self.values}.items() if name != self.rough
        }

    def check(self, found: Identification) -> None:
        """Assert that terms, hold and values are right, and that intervals are wide enough."""
        alone = found.model == "link"
        terms = ("gravity",) if alone else PAPER_TERMS
        assert found.choices.terms == (*terms, *self.terms)
        assert alone or found.choices.hold == self.hold
        assert found.disturbances is None
        assert max(found.residual_excess.values()) < 1.1
        assert not any("contradicts" in warning for warning in found.warnings)
        alignment = found.choices.alignment
        delays = {"input_delay": alignment.input_delay, "link_delay": alignment.link_delay}
        for parameter, value in self.truth(alone=alone).items():
            estimate: Any = {**found.parameters, **delays}[parameter]
            assert estimate.value == pytest.approx(value, rel=self.accuracy), parameter
            low, high = estimate.interval
            assert abs(estimate.value - value) <= 1.5 * (high - low), parameter
            if parameter in delays:
                is_given = getattr(self.settings, parameter) != "auto"
                assert estimate.status == ("given" if is_given else "found")
            else:
                assert estimate.verdict == "determined", parameter
        assert {name: found.choices.shapes[name] for name in self.shapes} == self.shapes
