"""The rate of the state-variable filter, chosen from the data.

A slow filter averages more noise away, a fast one sees more of the motion. Where the model is
right, every rate gives the same coefficients but for noise, and the smallest predicted standard
deviation decides. Where it is not, each rate hides another part of the motion, and coefficients
that explain only what the slowest filter lets through are of no use. So each candidate's
coefficients are put before the equations of all other rates first, and only those that do about as
well there as any may compete.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from flexid.arrays import FloatArray
from flexid.errors import SettingError
from flexid.estimators.samples import Samples
from flexid.estimators.state_variable_filter import LeastSquaresFit, filtered_least_squares
from flexid.estimators.unknowns import Unknowns
from flexid.models.parametric_system import ParametricSystem
from flexid.recording.recording import Hold

FASTEST = 0.5
"""Largest product of filter rate and sample time. Equations of positions hold at the samples, and
so for any filter; but a faster one lets the encoders' noise through to regressors, too. Its bias is
within the intervals up to here, and at twice as much within every second one.
"""

SLOWEST = 1e-5
"""Smallest product. In single precision a filter rounds what passes it by 2e-4 here, and by a
hundredth at a tenth of it."""

_STEP = np.sqrt(2.0)  # between one candidate and the next
_SLOWEST = 100.0  # over the record's duration: ten blocks of ten time constants each
_TOLERANCE = 0.03  # excess of the mean log residual that counts as "about as well"


def check_filter_rate(
    filter_rate: float, sample_time: float, *, slowest: float = 1.0, fastest: float = 1.0
) -> None:
    """Raise unless a filter suits the samples.

    Parameters
    ----------
    filter_rate : float
        In 1/s.
    sample_time : float
        In s.
    slowest, fastest : float, optional
        Multiples of the rate at which filters run beside.

    Raises
    ------
    SettingError
        If it is too slow or too fast, with the rates that are not.
    """
    least, most = SLOWEST / (slowest * sample_time), FASTEST / (fastest * sample_time)
    if not least <= filter_rate <= most:
        raise SettingError(
            "filter rate",
            f"{filter_rate:g} 1/s does not suit samples every {sample_time:g} s: give {least:.3g} "
            f"to {most:.3g} 1/s",
        )


def candidate_rates(recordings: Sequence[Samples]) -> FloatArray:
    """Rates in 1/s that the length and the sample time of a record allow, ascending."""
    duration = sum(len(recording) * recording.sample_time for recording in recordings)
    fastest = FASTEST / min(recording.sample_time for recording in recordings)
    slowest = min(_SLOWEST / duration, fastest)
    count = 1 + int(np.log(fastest / slowest) / np.log(_STEP))
    return slowest * _STEP ** np.arange(count)


def choose_filter_rate(
    recordings: Sequence[Samples],
    system: ParametricSystem,
    hold: Hold = "linear",
    unknowns: Unknowns | None = None,
) -> float:
    """Choose λ: about the best at explaining the equations of every rate, then the least noisy.

    Parameters
    ----------
    recordings : sequence of Samples
        One or more contiguous recordings of motion.
    system : ParametricSystem
        The model.
    hold : {"linear", "zero"}, optional
        Hold of the inputs.
    unknowns : Unknowns, optional
        What is sought, if not every coefficient of the system from all recordings together.

    Returns
    -------
    float
        λ in 1/s.
    """
    rates = candidate_rates(recordings)
    fits = [filtered_least_squares(recordings, system, rate, hold, unknowns) for rate in rates]
    regrets = np.array([[_regret(fit, other) for other in fits] for fit in fits]).mean(axis=1)
    spreads = [
        _log_spread(fit) if regret <= regrets.min() + _TOLERANCE else np.inf
        for fit, regret in zip(fits, regrets, strict=True)
    ]
    return float(rates[int(np.argmin(spreads))])


def _regret(fit: LeastSquaresFit, judge: LeastSquaresFit) -> float:
    """Log of the residual that a fit leaves in another's equations, over the least possible."""
    regret = 0.0
    edges = np.cumsum([0, *(len(row.coefficients) for row in judge.rows)])
    for row, (start, stop) in zip(judge.rows, pairwise(edges), strict=True):
        difference = fit.values[start:stop] - judge.values[start:stop]
        # Least squares: the residual grows by this quadratic form and by nothing else.
        excess = float(difference @ row.gram @ difference)
        regret += np.log1p(excess / row.residual_sum) if row.residual_sum > 0.0 else 0.0
    return regret


def _log_spread(fit: LeastSquaresFit) -> float:
    """Mean log variance of the coefficients that the data determine."""
    variances = np.diag(fit.covariance)
    usable = variances[np.isfinite(variances) & (variances > 0.0)]
    return float(np.mean(np.log(usable))) if len(usable) else 0.0
