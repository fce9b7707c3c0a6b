"""Thresholds of an identification, each with its unit and reason."""

from dataclasses import dataclass, field, fields
from numbers import Real
from typing import Any

from flexid.errors import SettingError


def _threshold(value: float, unit: str, reason: str) -> Any:
    return field(default=value, metadata={"unit": unit, "reason": reason})


@dataclass(frozen=True)
class Thresholds:
    """Thresholds for all decisions of an identification.

    The metadata of each field has its unit and the reason for its value; `table` lists them.
    """

    determined_width: float = _threshold(
        0.2, "1", "half the interval over the value, up to which a number is determined"
    )
    weak_width: float = _threshold(
        1.0, "1", "half the interval over the value; beyond it not even the sign is known"
    )
    negligible_share: float = _threshold(
        0.04,
        "1",
        "half the interval of a term over its row's acceleration, up to which the term is "
        "determined to be negligible",
    )
    noted_width: float = _threshold(
        0.01,
        "1",
        "half the widest interval, over the value or over its row's acceleration, up to which a "
        "model error within `sensor_excess` gives no warning: the intervals cover it, and 1 % "
        "changes no decision",
    )
    term_chance: float = _threshold(
        0.005,
        "1",
        "probability of a coefficient as large by chance, above which its term is removed; a dozen "
        "are tried, so one log in twenty keeps a term that the drive lacks",
    )
    generous_chance: float = _threshold(
        0.1,
        "1",
        "the same probability for terms that must also improve predictions of held-out data, and "
        "for frictions next to disturbances: a short log of a drive that no model describes shows "
        "friction at 0.02 and is predicted far better with it; without it inertias are 20 % too "
        "large",
    )
    generous_gain: float = _threshold(
        0.05,
        "1",
        "least relative fall of the prediction errors of held-out data, as a geometric mean, for "
        "such terms",
    )
    shape_chance: float = _threshold(
        0.001, "1", "the same probability for unusual terms, of which there are many"
    )
    hold_fall: float = _threshold(
        9.0,
        "1",
        "fall of the residuals' weighted sum of squares, over their mean square, with the cost of "
        "a delay, up to which one hold is no better: chance gives 9 in one log of 400",
    )
    exchange_fall: float = _threshold(
        9.0,
        "1",
        "least fall of the residuals' weighted sum of squares, over their variance, for one more "
        "coefficient: chance gives 9 in one log of 400",
    )
    friction_sign: float = _threshold(
        4.0, "standard deviations", "below zero, up to which a negative friction is removed"
    )
    sensor_excess: float = _threshold(
        1.1,
        "1",
        "mean square of residuals over the sensors' noise, up to which an error of that noise "
        "may explain it: an encoder's steps are not white noise while the joint hardly moves",
    )
    shape_promise: float = _threshold(
        0.25,
        "1",
        "least share of the residuals beyond noise that a first step predicts to remove, for "
        "hysteresis of the spring, ripple or a bend to be tried: 0.29 or more in logs of such "
        "drives, mostly above 0.9; no term below was ever kept",
    )
    shape_share: float = _threshold(
        0.7,
        "1",
        "least share of the residuals beyond those of short segments that a few steps remove, for "
        "the term to be fitted: hysteresis removes all but 0.02 if the drive has it, up to half "
        "if the spring bends instead",
    )
    white_growth: float = _threshold(
        0.4,
        "1",
        "distance from 3 of the power of time with which residuals grow, up to which they are "
        "white noise of the torque: estimates of that power scatter by about as much",
    )
    repeated_growth: float = _threshold(
        0.8,
        "1",
        "the same distance, from which on all of the residuals are an error that repeats itself: "
        "errors of friction and spring reverse with the motion and grow by a lower power, errors "
        "of a slow torque by the fourth",
    )
    noise_motion: float = _threshold(
        0.1,
        "1",
        "residuals beyond noise over the deflection, up to which white noise of the torque may "
        "cause them: noise of 2 % causes 0.0003 to 0.005; residuals as large as the deflection are "
        "all an error",
    )
    shape_motion: float = _threshold(
        0.12,
        "1",
        "residuals beyond noise over the deflection, over half a second (in proportion over "
        "shorter segments), up to which a missing term may cause them: drives with such a term "
        "leave up to 0.08 without it, a laboratory arm 0.16 to 0.7, two axes taken for one 0.18; "
        "above it disturbances are fitted instead of terms",
    )
    exact_share: float = _threshold(
        0.005,
        "1",
        "residuals beyond noise over the deflection, over half a second (in proportion over "
        "shorter segments), up to which a fit without disturbances may be reported: noise of the "
        "torque and jitter leave 0.001 or less, and the fit is right; a second bending mode and a "
        "dead zone leave 0.009 and more, and its intervals miss the truth by 6 standard deviations",
    )
    lost_share: float = _threshold(
        0.007,
        "1",
        "share of its row's acceleration due to the worst combination of coefficients, below "
        "which the combination is unknown: without this rule 25 of 49 logs of one sine below it "
        "have a determined value that is wrong by more than 1 %, and none of 26 above it",
    )
    contradiction: float = _threshold(
        3.0,
        "standard deviations",
        "between log and prior knowledge, above which they contradict each other",
    )

    def __post_init__(self) -> None:
        for one in fields(self):
            value = getattr(self, one.name)
            if isinstance(value, bool) or not isinstance(value, Real) or not float(value) >= 0.0:
                raise SettingError(one.name, f"must be a number from 0 on, got {value!r}")

    def noise_floor(self, shortest: float) -> float:
        """Return the excess that counts as noise: the excess over the shortest segments, clipped.

        An encoder's steps are not white noise; they leave a little more than 1 even there.

        Parameters
        ----------
        shortest : float
            Excess over the shortest segments.

        Returns
        -------
        float
            At least 1 and at most `sensor_excess`.
        """
        return min(max(shortest, 1.0), self.sensor_excess)


THRESHOLDS = Thresholds()
"""Default thresholds."""


def table(thresholds: Thresholds = THRESHOLDS) -> list[tuple[str, float, str, str]]:
    """Return name, value, unit and reason of every threshold."""
    return [
        (f.name, getattr(thresholds, f.name), f.metadata["unit"], f.metadata["reason"])
        for f in fields(thresholds)
    ]
