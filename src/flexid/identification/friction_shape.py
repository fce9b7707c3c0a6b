"""What the shape of friction adds to the uncertainty.

No drive's friction is a tanh of the velocity. How fast it really changes sign is known only as far
as the log shows, and hardly shows in the residuals, but moves the coefficients by more than noise
does where encoders are fine. So the fit is repeated with friction that changes sign over half and
over twice the velocity, and the changes count as standard deviations.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from flexid.errors import ConvergenceError
from flexid.estimators.prediction_error import PredictionErrorFit
from flexid.estimators.state_variable_filter import LeastSquaresFit
from flexid.identification.candidate import Candidate, Fitted
from flexid.identification.intervals import Fitted as IntervalFit
from flexid.identification.intervals import FloatArray
from flexid.identification.joint import DRY_FRICTION
from flexid.models.terms import SMOOTHING
from flexid.recording.recording import Recording

_FACTORS = (0.5, 2.0)


@dataclass(frozen=True, eq=False)
class Widened:
    """A fit whose covariance heeds what is not known of the model.

    Parameters
    ----------
    names : tuple of str
        What was sought.
    values : array, shape (k,)
        Their values.
    covariance : array, shape (k, k)
        With the uncertainty of the model.
    degrees_of_freedom : tuple of float
        Of each variance.
    """

    names: tuple[str, ...]
    values: FloatArray
    covariance: FloatArray
    degrees_of_freedom: tuple[float, ...]


def with_friction_shape(
    candidate: Candidate,
    reported: Fitted[LeastSquaresFit] | Fitted[PredictionErrorFit],
    recordings: Sequence[Recording],
    groups: Sequence[int],
) -> IntervalFit:
    """Add the uncertainty of the shape of friction, where there is dry friction.

    Parameters
    ----------
    candidate : Candidate
        What was fitted, with the constants of the fit.
    reported : Fitted
        Its fit to the recordings; least squares stays as it is, for it hardly sees the shape.
    recordings : sequence of Recording
        Pieces.
    groups : sequence of int
        The log of each.
    """
    fit = reported.fit
    if not DRY_FRICTION & set(candidate.terms) or not isinstance(fit, PredictionErrorFit):
        return fit
    joint = candidate.joint
    fixed = {**candidate.fixed, **reported.at_bound}
    covariance = np.array(fit.covariance)
    for factor in _FACTORS:
        other = joint.with_coulomb_velocity(factor * joint.system.constants[SMOOTHING])
        reshaped = replace(candidate, joint=other, fixed=fixed, bounds={})
        try:
            change = reshaped.prediction_error(recordings, groups).fit.values - fit.values
        except ConvergenceError:  # friction of that shape is no friction of this drive
            continue
        covariance += np.where(np.isfinite(covariance), np.outer(change, change), 0.0)
    return Widened(fit.names, fit.values, covariance, tuple(fit.degrees_of_freedom))
