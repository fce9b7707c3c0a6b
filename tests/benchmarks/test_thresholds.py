"""The table of what half and twice each threshold would change."""

from dataclasses import fields

from benchmarks.thresholds import UNTOUCHED, moved

from flexid.identification.vocabulary.thresholds import THRESHOLDS


def test_each_threshold_is_halved_and_doubled():
    """Assert that one threshold moves at a time, and all but those that no trial can show."""
    names = {field.name for field in fields(THRESHOLDS)} - {*UNTOUCHED}
    found = dict(moved())
    assert set(found) == {f"{name} x {factor}" for name in names for factor in ("0.5", "2")}
    for name, thresholds in found.items():
        own, factor = name.split(" x ")
        other = {f.name: getattr(thresholds, f.name) for f in fields(thresholds)}
        assert other.pop(own) == float(factor) * getattr(THRESHOLDS, own)
        assert all(value == getattr(THRESHOLDS, rest) for rest, value in other.items())
