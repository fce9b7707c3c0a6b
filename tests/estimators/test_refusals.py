"""Settings of estimators that are refused, each in one sentence that names what is wrong."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest
from noisy_joint import TRUTH, encoders

from flexid.errors import ModelError, SettingError
from flexid.estimators.bounded import bounded_fit
from flexid.estimators.online import packed
from flexid.estimators.prediction_error import prediction_error
from flexid.estimators.recursive_least_squares import recursive_least_squares
from flexid.estimators.segments import FEWEST_SAMPLES, divide
from flexid.estimators.state_variable_filter import check_filter_rate, filtered_least_squares
from flexid.estimators.unknowns import Unknowns
from flexid.models.flexible_joint import flexible_joint
from flexid.paper.parametric_observer import parametric_observer

JOINT = flexible_joint()
BENT = flexible_joint(("bent_spring",)).seeking({"bend_deflection"})
MEMORY = flexible_joint(("spring_hysteresis",))
OFFSET = flexible_joint(("gravity", "motor_viscous", "link_offset"))
DAMPED = flexible_joint(("gravity", "motor_viscous", "joint_damping"))
FRICTION = flexible_joint(("gravity", "motor_coulomb"))
POSITIONS = encoders(0)
FEW = replace(POSITIONS, positions=POSITIONS.positions[:5], inputs=POSITIONS.inputs[:5])

least_squares = partial(filtered_least_squares, [POSITIONS])
recursive = partial(recursive_least_squares, JOINT)
by_motion = partial(prediction_error, [POSITIONS], JOINT)
filter_rate = partial(check_filter_rate, sample_time=1e-3)


def within(**bounds: tuple[float, float]) -> None:
    """Least squares of the joint within bounds."""
    bounded_fit(lambda sought: least_squares(JOINT, unknowns=sought), Unknowns(JOINT), bounds)


REFUSED: list[tuple[Callable[..., Any], dict[str, Any], str]] = [
    *((least_squares, {"system": JOINT, "filter_rate": r}, "filter_rate") for r in (0.0, np.inf)),
    *((least_squares, {"system": JOINT, "filter_rate": r}, "filter_rate") for r in (-1.0, np.nan)),
    (least_squares, {"system": FRICTION}, "alpha_coulomb"),
    (least_squares, {"system": JOINT, "unknowns": Unknowns(OFFSET)}, "unknowns"),
    (least_squares, {"system": JOINT, "unknowns": Unknowns(JOINT, groups=(0, 1))}, "groups"),
    (by_motion, {"start": least_squares(OFFSET)}, "start"),
    (recursive(sample_time=1e-3).init, {"values": {"theta9": 1.0}}, "theta9"),
    (recursive(sample_time=1e-3).init, {"values": {"theta1": np.nan}}, "nan"),
    (recursive, {"sample_time": 0.0}, "sample_time"),
    (recursive, {"sample_time": 1e-3, "filter_rate": 0.0}, "filter_rate"),
    (recursive, {"sample_time": 1e-3, "memory": 1e-3}, "memory"),
    (recursive, {"sample_time": 1e-3, "memory": np.nan}, "memory"),
    *((filter_rate, {"filter_rate": r}, "give 0.01 to 500 1/s") for r in (0.0099, 501.0, np.nan)),
    (filter_rate, {"filter_rate": 126.0, "slowest": 0.25, "fastest": 4.0}, "give 0.04 to 125 1/s"),
    (parametric_observer, {"system": JOINT, "gain": {"link": 1.0}, "sample_time": 1e-3}, "gain"),
    (
        parametric_observer,
        {"system": JOINT, "gain": {"link": 1.0, "motor": -1.0}, "sample_time": 1e-3},
        "gain",
    ),
    (packed, {"samples": POSITIONS}, "velocities"),
    *((divide, {"recordings": [POSITIONS], "duration": d}, "duration") for d in (0, -1.0, np.inf)),
    (divide, {"recordings": [FEW], "duration": 1.0}, str(FEWEST_SAMPLES)),
    (Unknowns, {"system": JOINT, "fixed": {"gamma": 1.0}}, "gamma"),
    (Unknowns, {"system": JOINT, "fixed": {"theta1": np.nan}}, "theta1"),
    (Unknowns, {"system": JOINT, "fixed": TRUTH}, "every coefficient"),
    (Unknowns, {"system": JOINT, "per_group": ("gamma",)}, "gamma"),
    (Unknowns, {"system": JOINT, "groups": (0, -1)}, "counted from 0"),
    (Unknowns, {"system": DAMPED, "tied": {"gamma": ("alpha1", "theta2", "alpha1")}}, "gamma"),
    (
        Unknowns,
        {"system": DAMPED, "tied": {"theta_damping": ("alpha1", "gamma", "theta2")}},
        "gamma",
    ),
    (within, {"gamma": (0.0, 1.0)}, "gamma"),
    (within, {"theta1": (2.0, 1.0)}, "theta1"),
    (within, {"theta1": (np.nan, 1.0)}, "theta1"),
    (within, dict.fromkeys(TRUTH, (1e6, 1e7)), "every coefficient"),
]


@pytest.mark.parametrize(("call", "arguments", "fragment"), REFUSED)
def test_what_is_refused(call: Callable[..., Any], arguments: dict[str, Any], fragment: str):
    """Assert that the sentence of the error says what is wrong."""
    with pytest.raises(SettingError) as refused:
        call(**arguments)
    assert fragment in str(refused.value)


@pytest.mark.parametrize("rate", [0.0101, 499.0])
def test_filters_that_suit(rate: float):
    """Assert that rates just within the limits are taken."""
    check_filter_rate(rate, 1e-3)


@pytest.mark.parametrize(
    ("system", "name"), [(BENT, "bend_deflection"), (MEMORY, "hysteresis_grip")]
)
@pytest.mark.parametrize(
    "estimator",
    [least_squares, lambda system: recursive_least_squares(system, 1e-3)],
    ids=["least squares", "recursive"],
)
def test_least_squares_of_what_is_not_linear_is_refused(estimator, system, name):
    """Assert that the coefficient is named in which the model is not linear."""
    with pytest.raises(ModelError, match=f"is not linear in {name}"):
        estimator(system)
