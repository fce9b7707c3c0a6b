"""Settings that estimators refuse, each in one sentence."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest
from noisy_joint import TRUTH, encoders

from flexid.estimators.online import packed
from flexid.estimators.prediction_error import prediction_error
from flexid.estimators.recursive_least_squares import recursive_least_squares
from flexid.estimators.samples import divide
from flexid.estimators.state_variable_filter import check_filter_rate, filtered_least_squares
from flexid.estimators.unknowns import Unknowns, bounded_fit
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
    """Fit the joint by least squares within bounds."""
    bounded_fit(lambda sought: least_squares(JOINT, unknowns=sought), Unknowns(JOINT), bounds)


RATES = (0.0, np.inf, -1.0, np.nan)
PACE: dict[str, Any] = {"sample_time": 1e-3}
UNKNOWNS: dict[str, dict[str, Any]] = {
    "a fixed name": {"system": JOINT, "fixed": {"gamma": 1.0}},
    "a fixed value": {"system": JOINT, "fixed": {"theta1": np.nan}},
    "all fixed": {"system": JOINT, "fixed": TRUTH},
    "a name of groups": {"system": JOINT, "per_group": ("gamma",)},
    "a group": {"system": JOINT, "groups": (0, -1)},
    "a tied name": {"system": DAMPED, "tied": {"gamma": ("alpha1", "theta2", "alpha1")}},
    "a tie's source": {"system": DAMPED, "tied": {"theta_damping": ("alpha1", "gamma", "theta2")}},
}
REFUSED: dict[str, Callable[[], object]] = {
    **{f"a filter of {r}": partial(least_squares, JOINT, filter_rate=r) for r in RATES},
    "friction that jumps": partial(least_squares, FRICTION),
    "other unknowns": partial(least_squares, JOINT, unknowns=Unknowns(OFFSET)),
    "two groups": partial(least_squares, JOINT, unknowns=Unknowns(JOINT, groups=(0, 1))),
    "another start": lambda: by_motion(start=least_squares(OFFSET)),
    "a start's name": partial(recursive(**PACE).init, {"theta9": 1.0}),
    "a start's value": partial(recursive(**PACE).init, {"theta1": np.nan}),
    "no sample time": partial(recursive, sample_time=0.0),
    "no filter": partial(recursive, **PACE, filter_rate=0.0),
    **{f"a memory of {m}": partial(recursive, **PACE, memory=m) for m in (1e-3, np.nan)},
    **{f"a rate of {r}": partial(filter_rate, r) for r in (0.0099, 501.0, np.nan)},
    "a rate of 126 for 0.25 to 4 ms": partial(filter_rate, 126.0, slowest=0.25, fastest=4.0),
    **{
        f"gains {gains}": partial(parametric_observer, JOINT, gains, **PACE)
        for gains in ({"link": 1.0}, {"link": 1.0, "motor": -1.0})
    },
    **{
        f"{what} of a wrong size": partial(getattr(recursive(**PACE), method), *values)
        for what, method, values in (
            ("a state", "step", (np.zeros(3), np.zeros(3))),
            ("a sample", "step", (recursive(**PACE).init(), np.zeros(2))),
            ("samples", "replay", (recursive(**PACE).init(), np.zeros((5, 9)))),
            ("a state to read", "coefficients", (np.zeros(3),)),
        )
    },
    "no velocities": partial(packed, POSITIONS),
    **{f"segments of {d} s": partial(divide, [POSITIONS], d) for d in (0, -1.0, np.inf)},
    "few samples": partial(divide, [FEW], 1.0),
    **{name: partial(Unknowns, **about) for name, about in UNKNOWNS.items()},
    "a bound's name": partial(within, gamma=(0.0, 1.0)),
    "bounds turned round": partial(within, theta1=(2.0, 1.0)),
    "a bound that is none": partial(within, theta1=(np.nan, 1.0)),
    "bounds of all": partial(within, **dict.fromkeys(TRUTH, (1e6, 1e7))),
    **{
        f"{kind} of {name}": partial(estimator, system)
        for name, system in {"a bend": BENT, "a memory": MEMORY}.items()
        for kind, estimator in {
            "least squares": least_squares,
            "recursive least squares": partial(recursive_least_squares, **PACE),
        }.items()
    },
}


def test_what_is_refused(refusals: Any):
    """Assert that the error names what is wrong."""
    refusals(REFUSED)


@pytest.mark.parametrize("rate", [0.0101, 499.0])
def test_filters_that_suit(rate: float):
    """Assert that rates just within the limits are accepted."""
    check_filter_rate(rate, 1e-3)
