"""Warnings about a result, and whether its log shows a compliance."""

import pickle
from dataclasses import replace
from functools import cache
from itertools import product
from math import inf, nan
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from made_joint import data, made

import flexid.identification.estimation.spring_doubts as spring_doubts
from flexid.identification.judgement import of_joint, of_link_alone, widest
from flexid.identification.preparation.joint import Kind
from flexid.identification.preparation.recordings import Delay, SplitRecordings
from flexid.identification.result import (
    _delay,
    division_warnings,
    model_warnings,
    validation_warnings,
)
from flexid.identification.vocabulary.evidence import (
    Disturbances,
    ModelError,
    Validation,
    ValueEstimate,
    Verdict,
)
from flexid.recording.recording import Caution, Rank, cautions, ranked

ERRORS = [(0.09, 0.009), (0.11, 0.009), (0.09, 0.011), (0.09, inf), (0.004, inf), (2.0, 0.1)]
FITS = {"link_position": 12.3, "motor_position": -inf, "deflection": nan, "other": 99.0}
FREE_RUNS = {"fails": FITS, "serves": {"link_position": 99.0}}
DELAYS = (
    Delay(2.0001e-3, 0.0, (1.9998e-3, 2.0004e-3), "found"),
    Delay(-3.766e-3, 0.0, (-32.2e-3, 24.7e-3), "found"),
    Delay(1e-3, 0.0, (1e-3, 1e-3), "found"),
)
INERTIAS: tuple[dict[str, Verdict], ...] = (
    {"motor_inertia": "weak", "total_inertia": "determined"},
    {"motor_inertia": "determined", "total_inertia": "determined"},
    {"motor_inertia": "weak"},
)
KINDS: tuple[Kind, ...] = ("flexible", "link", "rigid")


def test_what_is_said_of_a_fit(golden):
    """Assert that a model error is reported if it exceeds noise or widens an interval.

    An unexplained share is reported from 2 % on. All channels with a poor free run are in one
    warning. A delay has enough digits to tell both ends of its interval apart. A data sheet is
    requested if only the sum of inertias is determined.
    """
    found = {
        f"{kind}, excess {excess}, width {width}": model_warnings(
            ModelError(excess, 1.0, 1.0), kind, width
        )
        for kind, (excess, width) in product(KINDS, ERRORS)
    }
    for share in (0.019, 0.021):
        shares = Disturbances({"link": 0.001, "motor": share}, 0.01)
        nothing = ModelError(0.0, 0.0, 0.0)
        found[f"unexplained {share}"] = model_warnings(nothing, "flexible", 0.1, shares)
    found |= {f"a free run {name}": validation_warnings(fits) for name, fits in FREE_RUNS.items()}
    found |= {f"a delay of {one.value}": [_delay("link", one)] for one in DELAYS}
    for verdicts in INERTIAS:
        said = {n: ValueEstimate(n, "", 1.0, 0.3, (0.4, 1.6), v) for n, v in verdicts.items()}
        found[", ".join(map(" ".join, verdicts.items()))] = division_warnings(said)
    golden({name: " | ".join(ranked(said)) for name, said in found.items()})


def test_warnings_come_in_the_order_in_which_to_act():
    """Assert the order of warnings by rank, from wrong data to notes, stable within a rank."""
    said = ["note", *(Caution(rank.name, rank) for rank in reversed(Rank)), "last"]
    assert ranked(said) == ("DATA", "SCALE", "MODEL", "MOTION", "note", "NOTE", "last")
    kept = pickle.loads(pickle.dumps(said[1:2]))  # as between processes
    assert (kept[0], kept[0].rank) == ("NOTE", Rank.NOTE)
    assert cautions(Rank.MODEL, ["new", Caution("old", Rank.DATA)])[1].rank == Rank.DATA


def test_the_widest_interval_counts_by_what_it_means():
    """Assert that a given value has width zero, and a value near zero counts by its effect."""
    values = {"theta2": (100.0, 1.0), "beta1": (3.0, 0.0), "alpha_offset": (0.0, 2.0)}
    found = {
        name: ValueEstimate(name, "", value, half, (value - half, value + half), "determined")
        for name, (value, half) in values.items()
    }
    assert widest(found, {"theta2": 0.5, "alpha_offset": 0.003}) == pytest.approx(0.01)
    assert widest(found, {"alpha_offset": 0.02}) == pytest.approx(0.04)
    assert widest(found, {}) == np.inf
    assert widest({}, {}) == 0.0


STIFF = 10_000.0  # N m/rad
START = 3333


@cache
def recordings(stiffness: float, noise: float) -> SplitRecordings:
    """Return ten seconds of a joint with this stiffness, with the last third held out."""
    recording = made(41, noise=noise, joint_stiffness=stiffness, size=0.6)
    return SplitRecordings((recording,), (START,), (0,))


SHOWN = {100.0: (51.0, 49.0, nan), STIFF: (5.0, 65.0, 68.0)}  # explained share, in per cent
VERDICTS: tuple[Verdict, ...] = ("determined", "weak", "undetermined")


def test_what_is_seen(golden):
    """Assert whether the compliance is visible, and the reason if it is not.

    Two thirds explained are no noise. Without a torque, an undetermined spring explains nothing.
    """
    found = {}
    for stiffness, noise in ((100.0, 1e-5), (STIFF, 3e-3)):
        log = recordings(stiffness, noise)
        for shown in SHOWN[stiffness]:
            one = of_joint(log, Validation({"deflection": shown}, ()))
            found[f"{stiffness:g} N m/rad, {shown:g} %"] = f"{one.visible} {one.reason}"
            assert one.deflection == pytest.approx(np.std(log.recorded[0].deflection[START:]))
            assert one.deflection_noise == pytest.approx(noise * 2**0.5, rel=0.1)
    for verdict in VERDICTS:
        spring = ValueEstimate("theta2", "1/s^2", 100.0, 1.0, (0.0, 1e3), verdict)
        driven = Validation({"deflection": 90.0}, ())
        one = of_link_alone(recordings(100.0, 1e-5), driven, spring)
        found[f"the link alone, {verdict}"] = f"{one.visible} {one.reason}"
    golden(found)


def test_a_motion_that_has_died_out_was_seen_before():
    """Assert that a deflection at rest in the held-out part is judged by all of it."""
    moving = recordings(100.0, 1e-5).recorded[0]
    fading = np.where(np.arange(len(moving)) < START, moving.deflection, 0.0)
    still = replace(moving, link_position=moving.motor_position + fading)
    one = of_joint(SplitRecordings((still,), (START,), (0,)), Validation({"deflection": nan}, ()))
    assert one.visible
    assert one.deflection == pytest.approx(np.std(fading))
    assert "before the held-out part" in one.reason


def test_a_period_is_predicted_from_the_one_before(monkeypatch):
    """Assert that compliance is decided by prediction over one period, after one of warm-up.

    If the end is at rest, it begins one period after the start. For a drive with Stribeck friction,
    15 % of the deflection is predicted over a period after 0.5 s of warm-up, and 56 % after one.
    """
    asked = []

    def predicting(_, __, starts, horizons, warm_up):
        asked.append(([*starts], *horizons, warm_up))
        share = nan if len(asked) == 1 else 56.0
        return SimpleNamespace(horizons={horizons[0]: {"deflection": share}})

    monkeypatch.setattr(spring_doubts, "validate", predicting)
    fitted: Any = SimpleNamespace(by_name={"theta2": 900.0, "alpha1": 1600.0})
    logs = data(made(5, 4.0), made(6, 0.5))
    own = SimpleNamespace(whole=logs, recordings=SimpleNamespace(starts=(1000, 40)))
    period, share = spring_doubts._over_a_period(fitted, cast(Any, own))
    assert (period, share) == (pytest.approx(2.0 * np.pi / 50.0), 56.0)
    # In samples of 2 ms; the period has 63.
    assert asked == [([1000, 40], period, period), ([63, 40], period, period)]
