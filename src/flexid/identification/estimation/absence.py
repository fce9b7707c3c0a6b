"""What may hide behind the terms that a model does without.

That a term is not seen does not mean that it is not there: where the log cannot distinguish it from
others, these may have taken its part. Before the log was seen, a term may be absent or there, the
one as likely as the other, and of about the size of its row's acceleration, τ. With x ± s what the
log says of it beside the reported model,

    P(there) = 1 / (1 + sqrt(1 + τ²/s²) exp(-½ x²/s² τ²/(s² + τ²)))

(Bayes' factor of a normal prior), and what is there moves the others along the quadratic form of
the fit. A term that the log sees well and does not find adds nothing; one that it cannot see adds
half of all that it could be.
"""

from collections.abc import Mapping

import numpy as np

from flexid.arrays import FloatArray
from flexid.estimators.normal_equations import least_with, scaled_inverse
from flexid.identification.full_model.model import Fitted


def hidden_covariance(reported: Fitted, full: Fitted, scales: Mapping[str, float]) -> FloatArray:
    """Covariance, shape (k, k), of what was reported, from what the model does without."""
    names = list(full.names)
    kept = [names.index(name) for name in reported.names if name in names]
    places = [i for i, name in enumerate(reported.names) if name in names]
    added = np.zeros((len(reported.names), len(reported.names)))
    information = full.information
    values = full.values + full.minimum.reduced.values_step
    part = information[np.ix_(kept, kept)]
    inverse, _ = scaled_inverse(part, np.sqrt(np.maximum(np.diag(part), 0.0)))
    for i, name in enumerate(names):
        scale = scales.get(name, scales.get(name.partition("[")[0], 0.0))
        if i in kept or scale <= 0.0:
            continue
        beside = np.isin(np.arange(len(names)), [*kept, i])
        place = int(np.count_nonzero(beside[:i]))
        # As a difference what is left of its information would be lost in rounding.
        least = least_with(beside, information, values)
        variance = np.inf if least.free[place] else float(least.inverse[place, place])
        mean_square = _mean_square(float(least.values[place]), _deviation(full, i, variance), scale)
        shift = inverse @ information[kept, i]
        added[np.ix_(places, places)] += mean_square * np.outer(shift, shift)
    return added


def _deviation(full: Fitted, place: int, variance: float) -> float:
    """Standard deviation of a value beside the reported model, residuals' correlation counted."""
    robust = float(full.fit.deviations[place])
    factor = robust / float(full.unit_deviations[place]) if full.unit_deviations[place] else 1.0
    return max(factor if np.isfinite(factor) else 1.0, 1.0) * float(np.sqrt(variance))


def _mean_square(value: float, deviation: float, scale: float) -> float:
    """Mean square of a term that may be there or not."""
    if not np.isfinite(deviation):
        return 0.5 * scale**2
    both = deviation**2 + scale**2
    shrunk = scale**2 / both
    absent = np.sqrt(both) / deviation * np.exp(-0.5 * (value / deviation) ** 2 * shrunk)
    mean, variance = value * shrunk, deviation**2 * shrunk
    return (mean**2 + variance) / (1.0 + float(absent))
