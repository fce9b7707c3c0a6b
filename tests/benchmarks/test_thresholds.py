"""The table of what half and twice each threshold would change."""

from dataclasses import fields

from benchmarks.thresholds import UNTOUCHED, moved, table

from flexid.identification.vocabulary.thresholds import THRESHOLDS


def record(in_class: bool, verdict: str, low: float, terms: tuple[str, ...] = ("gravity",)) -> dict:
    """One log's record with one parameter, whose truth is 1."""
    return {
        "in_class": in_class,
        "truth": {"link_inertia": 1.0},
        "estimates": {"link_inertia": [1.1, low, 1.2, verdict]},
        "chosen": {"terms": list(terms), "hold": "zero"},
    }


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


def test_changes_are_counted():
    """Assert that a line counts logs with other choices, and scores what came of them."""
    plain = record(True, "determined", 0.9), record(False, "determined", 0.9)
    wrong = record(False, "determined", 1.05, ("gravity", "link_viscous"))
    logs = [{"": plain[0], "a x 2": plain[0], "b x 2": plain[0]}]
    logs += [{"": plain[1], "a x 2": wrong, "b x 2": plain[1]}]
    lines = table(logs)
    assert lines[2].startswith("|nothing|")
    assert lines[2].endswith("|100.0 %|100.0 %|100.0 %|100.0 %|0|")
    assert lines[3] == "|`a x 2`|1|0|0|100.0 %|0.0 %|100.0 %|100.0 %|1|"
    assert lines[-1] == "Nothing changes with `b x 2`."
