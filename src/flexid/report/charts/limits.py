"""What part of its data a panel shows."""

import numpy as np

from flexid.arrays import FloatArray


def whole_decades(values: FloatArray) -> tuple[float, float]:
    """Powers of ten about the values above 0, so that a logarithmic axis has labels.

    Examples
    --------
    >>> whole_decades(np.array([0.3, 20.0, 0.0, np.nan]))
    (0.1, 100.0)
    """
    usable = values[np.isfinite(values) & (values > 0.0)]
    if not len(usable):
        return 1.0, 10.0
    lowest, highest = np.floor(np.log10(usable.min())), np.ceil(np.log10(usable.max()))
    return float(10.0**lowest), float(10.0 ** max(highest, lowest + 1.0))


def with_margin(low: float, high: float, margin: float) -> tuple[float, float]:
    """Ends with a part of what is between them below and above them."""
    return low - margin * (high - low), high + margin * (high - low)
