"""How fast and how slow a state-variable filter may be."""

from flexid.errors import SettingError

FASTEST = 0.5
"""Largest product of filter rate and sample time. Equations of positions hold at the samples, and
so for any filter; but a faster one lets the encoders' noise through to regressors, too. Its bias is
within the intervals up to here, and at twice as much within every second one.
"""

SLOWEST = 1e-5
"""Smallest product. In single precision a filter rounds what passes it by 2e-4 here, and by a
hundredth at a tenth of it."""


def check_filter_rate(
    filter_rate: float, sample_time: float, *, slowest: float = 1.0, fastest: float = 1.0
) -> None:
    """Raise unless a filter suits the samples."""
    least, most = SLOWEST / (slowest * sample_time), FASTEST / (fastest * sample_time)
    if not least <= filter_rate <= most:
        raise SettingError(
            "filter rate",
            f"{filter_rate:g} 1/s does not suit samples every {sample_time:g} s: give {least:.3g} "
            f"to {most:.3g} 1/s",
        )
