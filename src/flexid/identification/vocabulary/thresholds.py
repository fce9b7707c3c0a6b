"""All thresholds of an identification, each with its unit and reason."""

from dataclasses import dataclass, field, fields
from typing import Any


def _threshold(value: float, unit: str, reason: str) -> Any:
    return field(default=value, metadata={"unit": unit, "reason": reason})


@dataclass(frozen=True)
class Thresholds:
    """What an identification decides by; pass others to see what would change.

    Each field's metadata holds its unit and the reason for its value; `table` lists them.
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
        "share of its row's acceleration that a term makes within its interval, up to which the "
        "term is determined to be as small as it is",
    )
    noted_width: float = _threshold(
        0.01,
        "1",
        "half the widest interval, over the value or over what moves its row, up to which a model "
        "error within `sensor_excess` is not worth a warning: the intervals hold it, and nobody "
        "would decide otherwise for 1 %",
    )
    term_chance: float = _threshold(
        0.005,
        "1",
        "probability of a coefficient as large by chance, from which on its term goes; a dozen are "
        "tried, so one log in twenty keeps one that is not there",
    )
    generous_chance: float = _threshold(
        0.1,
        "1",
        "the same for terms that have to pay on held-out data as well, and for frictions next "
        "to disturbances: a short log of a drive that no model describes shows friction at 0.02 "
        "and is predicted far better with it; without it inertias are 20 % too large",
    )
    generous_gain: float = _threshold(
        0.05,
        "1",
        "part of the held-out data's prediction errors, as a geometric mean, that such terms save",
    )
    shape_chance: float = _threshold(
        0.001, "1", "the same for terms beyond the usual ones, of which there are many"
    )
    hold_fall: float = _threshold(
        9.0,
        "1",
        "fall of the residuals' weighted sum of squares, over their mean square, and of what a "
        "delay costs, up to which one hold is no better: chance gives 9 in one log of 400",
    )
    exchange_fall: float = _threshold(
        9.0,
        "1",
        "fall of the residuals' weighted sum of squares, over their variance, that a coefficient "
        "more has to bring, and what is left with unusual terms in place of usual ones: chance "
        "gives 9 in one log of 400",
    )
    friction_sign: float = _threshold(
        4.0, "standard deviations", "below zero, up to which a negative friction is none"
    )
    sensor_excess: float = _threshold(
        1.1,
        "1",
        "mean square of residuals over the sensors' noise that may be an error of that noise: an "
        "encoder's steps are no white noise where the joint hardly moves",
    )
    shape_promise: float = _threshold(
        0.25,
        "1",
        "share of the residuals beyond noise that a first step with hysteresis of the spring, with "
        "ripple or a bend must promise to take away, for it to be tried: in logs that have it "
        "0.29 or more, mostly above 0.9; below that none was ever kept",
    )
    shape_share: float = _threshold(
        0.7,
        "1",
        "the same of a few steps, of what exceeds the residuals of short segments, for it to be "
        "followed up: of hysteresis all but 0.02 where there is some, up to half of it where a "
        "spring bends",
    )
    white_growth: float = _threshold(
        0.4,
        "1",
        "how far from 3 the power of time may be with which residuals grow, if they are white "
        "noise of the torque: estimates of that power scatter by about as much",
    )
    repeated_growth: float = _threshold(
        0.8,
        "1",
        "the same from which on they are an error that repeats itself in full: errors of friction "
        "and spring turn round with the motion and grow by less, one of slow torque by the fourth",
    )
    noise_motion: float = _threshold(
        0.1,
        "1",
        "residuals beyond noise over the deflection, up to which white noise of the torque may "
        "make them: noise of 2 % makes 0.0003 to 0.005; as large as the deflection itself they are "
        "an error in full",
    )
    shape_motion: float = _threshold(
        0.12,
        "1",
        "residuals beyond noise over the deflection, over half a second (over shorter segments in "
        "proportion), up to which a term may "
        "make them: drives with such a term leave up to 0.08 without it, an arm in a laboratory "
        "0.16 to 0.7, two axes taken for one 0.18; beyond it disturbances are fitted, no terms",
    )
    exact_share: float = _threshold(
        0.005,
        "1",
        "residuals beyond noise over the deflection, up to which a fit that knows of no more than "
        "that noise may be reported all the same: noise of the torque and jitter leave 0.001 or "
        "less and it is right; a second bending mode and a dead zone leave 0.009 and more, and "
        "its intervals miss by 6 standard deviations",
    )
    lost_share: float = _threshold(
        0.007,
        "1",
        "share of its row's acceleration that the worst combination of coefficients makes, below "
        "which it is lost: without this rule 25 of 49 logs of one sine below it have a determined "
        "value that is wrong by more than 1 %, and none of 26 above it",
    )
    contradiction: float = _threshold(
        3.0,
        "standard deviations",
        "between log and prior knowledge, beyond which they contradict",
    )

    def noise_floor(self, shortest: float) -> float:
        """Excess that is noise, from that over the shortest segments: these show no more.

        An encoder's steps are no white noise, and leave a little more than 1 even there.

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
"""Those that are used unless others are given."""


def table(thresholds: Thresholds = THRESHOLDS) -> list[tuple[str, float, str, str]]:
    """Name, value, unit and reason of every threshold."""
    return [
        (f.name, getattr(thresholds, f.name), f.metadata["unit"], f.metadata["reason"])
        for f in fields(thresholds)
    ]
