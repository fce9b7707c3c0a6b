"""What the residuals say about the model, and what that adds to every interval.

The spread of the scores from block to block knows nothing of an error that repeats itself in each
block. Of such an error the part across the coefficients shows in the residuals; the part along a
coefficient does not show at all, and is its bias. If both are alike in size, the bias of a
coefficient is its standard deviation for noise of the residuals' unit size, times the root of the
residuals' sum of squares beyond noise. Noise of the torque makes residuals large, too, without any
bias; it is told apart by what terms beyond the model find in them: nothing.
"""

from dataclasses import replace

import numpy as np

from flexid.errors import ConvergenceError
from flexid.identification.estimate import Estimate
from flexid.identification.full_model import FINE, Fitted, refit
from flexid.identification.judgement import Thresholds
from flexid.identification.result import ModelError


def model_error(fitted: Fitted, thresholds: Thresholds) -> ModelError:
    """Look for a model error in the residuals of a fit.

    Parameters
    ----------
    fitted : Fitted
        What is reported.
    thresholds : Thresholds
        What counts as evidence.
    """
    evidence = _evidence(fitted)
    share = max(0.0, 1.0 - thresholds.model_evidence / evidence) if evidence > 0.0 else 0.0
    return ModelError(fitted.excess, evidence, share)


def widened(fitted: Fitted, error: ModelError, thresholds: Thresholds) -> Estimate:
    """The estimate of a fit with the model's error in its covariance."""
    beyond = fitted.problem.degrees_of_freedom * max(0.0, error.excess - 1.0)
    factor = (thresholds.model_share * error.share) ** 2 * beyond
    return Estimate.of(fitted.fit).widened(factor * fitted.minimum.reduced.inverse)


def _evidence(fitted: Fitted) -> float:
    """Mean square of what terms beyond the model find, in their standard deviations."""
    structure = fitted.structure
    absent = structure.absent & structure.joint.optional
    if not structure.joint.shapes:
        return 0.0
    try:
        wider = refit(
            replace(structure, absent=structure.absent - absent, bounds={}),
            fitted.data,
            fitted.by_name,
            fitted.problem.segments,
            FINE,
            fitted.minimum.point.initial_states,
        )
    except ConvergenceError:
        return np.inf  # they find so much that they lead elsewhere
    deviations = np.sqrt(np.diag(wider.fit.covariance))
    places = [i for i, name in enumerate(wider.names) if name in absent]
    found = wider.values[places] / deviations[places]
    usable = found[np.isfinite(found)]
    return float(np.mean(usable**2)) if len(usable) else 0.0
