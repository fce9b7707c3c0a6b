"""Units: what is accepted, and that nothing passes for what it is not."""

from __future__ import annotations

from math import pi

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexid.recording.units import EXAMPLES, UnitError, scale_to_si


@pytest.mark.parametrize(
    ("text", "factor", "si_unit"),
    [
        ("deg", pi / 180, "rad"),
        ("°", pi / 180, "rad"),
        ("turn", 2 * pi, "rad"),
        ("deg/s", pi / 180, "rad/s"),
        ("rpm", pi / 30, "rad/s"),
        ("rad s^-1", 1.0, "rad/s"),
        ("Nm", 1.0, "N m"),
        ("N·m", 1.0, "N m"),
        ("N\u22c5m", 1.0, "N m"),
        ("mNm", 1e-3, "N m"),
        ("kN m", 1e3, "N m"),
        ("mV", 1e-3, "V"),
        ("mA", 1e-3, "A"),
        ("ms", 1e-3, "s"),
        ("us", 1e-6, "s"),
        ("µs", 1e-6, "s"),
    ],
)
def test_conversion(text: str, factor: float, si_unit: str) -> None:
    """Assert that a unit has its factor and its SI unit."""
    found, unit = scale_to_si(text, tuple(EXAMPLES))
    assert found == pytest.approx(factor, rel=1e-12)
    assert unit == si_unit


@pytest.mark.parametrize("text", ["count", "Hz", "percent", "1/s", "N m/rad", "m", "rad^2", ""])
def test_other_quantities(text: str) -> None:
    """Assert that what has the dimension of an angle or a rate by accident is refused."""
    with pytest.raises(UnitError, match="does not measure"):
        scale_to_si(text, tuple(EXAMPLES))


@pytest.mark.parametrize("text", ["furlongs!", "9^9^9", "km^9999", "km²³²³²³", "rad/", "__x", "("])
def test_unknown_units(text: str) -> None:
    """Assert that no unit text does more than fail."""
    with pytest.raises(UnitError, match=r"is not known: write \[rad\], \[deg\]"):
        scale_to_si(text, ("rad",))


@given(st.text(max_size=30))
def test_any_text(text: str) -> None:
    """Assert that any text is converted or refused."""
    try:
        factor, _ = scale_to_si(text, tuple(EXAMPLES))
    except UnitError:
        return
    assert factor > 0.0
