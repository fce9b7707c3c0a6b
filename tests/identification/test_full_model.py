"""The model of a log, its fit over segments of growing length, and the integration steps."""

from dataclasses import replace
from functools import cache
from itertools import pairwise
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from made_joint import COEFFICIENTS, JOINT, NOISE, PAPER, data, log, made, made_fit, structure

import flexid.identification.estimation.final_fits as final
import flexid.identification.full_model.fitting as fitting
from flexid.errors import ConvergenceError
from flexid.estimators.channel_timing import INPUT, Timing
from flexid.estimators.prediction_error import FINE, ROUGH, refinement
from flexid.identification.estimation.final_fits import FinalFits
from flexid.identification.full_model import fits_by_length, model
from flexid.identification.full_model.fitting import fit_by_length, fit_to, lengths, refit
from flexid.identification.full_model.model import Fitted
from flexid.identification.full_model.starting import least_squares_start
from flexid.identification.identify import identify
from flexid.identification.preparation.settings import Settings
from flexid.recording.recording import Recording
from flexid.recording.velocities import with_velocities

CHANNELS = ("link_position", "motor_position", "input")


@pytest.fixture(scope="module")
def late() -> model.Data:
    """Return eight seconds with a torque delay of 1.3 ms and a link delay of 0.7 ms."""
    return data(made(11, 8.0, input_delay=1.3e-3, link_delay=0.7e-3))


@pytest.mark.parametrize("rest", [0, 2000, 6000])
def test_halves_of_a_log_both_move(rest):
    """Assert that a log is cut in its middle, or in that of its motion if a half is rest."""
    moving = made(1, 8.0)
    ended = {name: np.pad(getattr(moving, name), (0, rest), mode="edge") for name in CHANNELS}
    own = data(replace(moving, **ended))
    first, second = (half.samples[0] for half in own.halves())
    assert len(first) + len(second) == len(moving) + rest
    assert (len(first) == len(second)) == (rest < len(moving))
    steps = (np.diff(half.positions[:, 1]) for half in (first, second))
    one, other = (np.sum(moved**2) for moved in steps)
    assert other > (0.7 if rest > len(moving) else 0.05) * one


def test_halves_have_a_quarter_of_a_log():
    """Assert that a half of a log of one pulse is not the pulse alone."""
    pulse = made(1, 6.0, torque=lambda at: np.where((at > 0.02) & (at < 0.06), 40.0, 0.0))
    first, second = (half.samples[0] for half in data(pulse).halves())
    assert min(len(first), len(second)) >= len(pulse) // 4


def test_what_data_know(late):
    """Assert the noise of each position, the reference of a deflection, and the margins."""
    assert late.noise == pytest.approx([NOISE, NOISE], rel=0.1)
    assert late.relative_to == {}
    recording = replace(made(1, 0.5, noise=0.0), link_from_deflection=True)
    still = data(replace(recording, motor_position=np.zeros(len(recording))))
    assert still.relative_to == {"link": "motor"}
    assert np.all(still.noise > 0.0)  # so that weights are finite
    # The margin at either end is at most a twentieth of the shortest recording.
    assert data(made(1, 8.0), made(1, 0.4)).margin == pytest.approx(0.02)
    assert data(made(1, 8.0)).margin == pytest.approx(0.03)
    late = [with_velocities(made(1, 8.0))]
    assert model.data_of(JOINT, late, [0], 0.2).margin == pytest.approx(0.2)
    assert data(made(1, 8.0)).duration == pytest.approx(8.0)


def test_parts_are_spread_over_every_recording():
    """Assert the samples of two pieces that are a quarter of each of two recordings."""
    whole = data(made(1, 8.0), made(2, 4.0))
    part = whole.in_part(0.25)
    assert part.groups == (0, 0, 1, 1)
    pieces = zip(part.samples, (0.0, 4.0, 0.0, 2.0), (0, 0, 1, 1), strict=True)
    for piece, start, place in pieces:
        own = whole.samples[place]
        first, length = round(start / own.sample_time), len(own) // 8
        assert np.array_equal(piece.positions, own.positions[first : first + length])
        assert piece.start_time == pytest.approx(own.start_time + start)


def test_lengths_double():
    """Assert that segments double in length, within margins of 30 ms."""
    divisions = lengths(data(made(1, 12.0, noise=0.0)))
    durations = [float(np.mean(s.lengths * s.sample_times)) for s in divisions]
    assert durations[0] < 2.0 * fitting.SHORTEST
    assert durations[-1] < 1.5 * fitting.LONGEST  # a whole fraction of the log
    for short, long in pairwise(divisions):
        assert np.array_equal(short.starts[::2], long.starts)
        assert len(short) == 2 * len(long)
    assert divisions[-1].starts[0] == 15  # 30 ms
    assert divisions[-1].lengths.sum() == 6000 - 30


def test_least_squares_starts_no_motion_that_runs_away(late):
    """Assert that starts have frictions of at least zero, and positive springs and inertias."""
    early = replace(PAPER, absent=PAPER.absent - {"theta_viscous", "alpha_cubic", "theta_cubic"})
    seen = replace(late.samples[0], positions=late.samples[0].positions.copy())
    seen.positions[10:, 0] = late.samples[0].positions[:-10, 0]
    start, fit = least_squares_start(early, replace(late, samples=(seen,)), 20.0)
    assert fit.by_name["theta_viscous"] < 0.0
    assert start["theta_viscous"] == 0.0
    assert min(start["theta2"], start["alpha1"], start["beta1"]) > 0.0
    assert start["alpha_cubic"] == 0.0
    turned = replace(late.samples[0], inputs=-late.samples[0].inputs)
    start, fit = least_squares_start(PAPER, replace(late, samples=(turned,)), 20.0)
    assert fit.by_name["beta1"] == pytest.approx(-10 / 3, rel=0.1)
    assert start["beta1"] == -fit.by_name["beta1"]


@pytest.mark.parametrize(
    ("ends", "kept"),
    [
        ("++++", "++++"),
        ("++x+", "++"),
        ("+xx", "+"),
        ("x+", None),
        # If the longest segments explain the log at once, lengths in between are skipped.
        ("oxxo", "o..o"),
        ("ooo+", "ooo+"),
        ("ooox", "ooo"),
    ],
)
def test_which_lengths_are_fitted(monkeypatch, ends, kept):
    """Assert which lengths are kept: o leaves only noise, + leaves more, x has no fit."""
    counts = [2 ** (len(ends) - i) for i in range(len(ends))]

    def fitted_over(_structure, _data, segments, _start, states, *_, **__):
        end = ends[counts.index(len(segments))]
        if end == "x":
            raise ConvergenceError("prediction error", "nowhere")
        assert states is None or len(states) == len(segments)
        excess = 1.0 if end == "o" else 2.0
        return made_fit(excess, segments=segments, states=np.zeros((len(segments), 4)))

    monkeypatch.setattr(fitting, "fit_segments", fitted_over)
    monkeypatch.setattr(fitting, "_is_known", lambda _: True)
    divisions, nothing = cast(Any, [range(count) for count in counts]), cast(Any, None)
    if kept is None:
        with pytest.raises(ConvergenceError):
            fit_by_length(nothing, nothing, {}, divisions)
        return
    found = fit_by_length(nothing, nothing, {}, divisions)
    expected = [count for count, end in zip(counts, kept, strict=False) if end != "."]
    assert [len(each.problem.segments) for each in found] == expected
    rest = fitting.longer_fits(found[0], divisions)
    assert [len(each.problem.segments) for each in rest] == expected[1:]


def test_fit_to_other_data():
    """Assert values, durations up to four times as long, and values at a bound."""
    other = data(made(12, 4.0))
    near = {c: 1.02 * v for c, v in COEFFICIENTS.items()}
    found, lengths_fitted = fit_to(PAPER, other, near, 1.0)
    assert found.duration == pytest.approx(1.0, rel=0.1)
    assert found in lengths_fitted
    durations = [one_length.duration for one_length in lengths_fitted]
    assert durations == sorted(durations)
    assert durations[-1] == pytest.approx(4.0, rel=0.1)
    assert found.values == pytest.approx(list(COEFFICIENTS.values()), rel=1e-3)
    found, _ = fit_to(replace(PAPER, bounds={"alpha2": (1.0, 2.0)}), other, COEFFICIENTS, 1.0)
    assert found.at_bound == {"alpha2": 1.0}
    assert "alpha2" not in found.names
    assert found.problem.unknowns.fixed["alpha2"] == 1.0


@pytest.mark.parametrize("wrong", [None, 1e3, 1.5])
def test_the_rest_follows_what_is_gone(wrong: float | None, monkeypatch):
    """Assert that a leaner fit starts at a predicted minimum if the wider fit's values fail.

    So it does if these lead to a minimum that leaves far more, as of a free swing with a wrong
    number of periods.
    """
    link_viscous = replace(PAPER, absent=PAPER.absent - {"theta_viscous"})
    wide, _ = fit_to(link_viscous, data(made(12, 1.0, noise=1e-3)), COEFFICIENTS, 0.5)
    lean = fitting.fit_like(PAPER, wide)
    assert lean is not None
    friction = lean.by_name["alpha2"]
    apart = abs(wide.by_name["alpha2"] - friction)
    begun = []

    def refit(structure, data, start, *rest):
        begun.append(start)
        if len(begun) == 1 and wrong is None:
            raise ConvergenceError("prediction error", "nowhere")
        return SimpleNamespace(excess=wrong) if len(begun) == 1 else lean

    monkeypatch.setattr(fitting, "refit", refit)
    is_close = wrong == 1.5
    assert (fitting.fit_like(PAPER, wide) is lean) is not is_close
    assert begun[0] == wide.by_name
    if is_close:
        return
    assert apart > 1e-3 * friction
    assert abs(begun[1]["alpha2"] - friction) < 0.05 * apart
    begun.clear()
    found = fitting.fit_like(link_viscous, wide)
    assert (found is None) == (wrong is None)
    assert len(begun) == 1  # no term was removed, so there is no other start


def test_terms_of_a_structure():
    """Assert that terms follow the motor's coefficients, and which ones are removed together."""
    only = [
        model.Structure(JOINT, frozenset(JOINT.optional - {"theta1", name}), Timing("zero")).terms
        for name in ("alpha_damping", "theta_damping")
    ]
    assert only == [("gravity", "joint_damping"), ("gravity",)]
    full = model.Structure(JOINT, frozenset(), Timing("zero", {INPUT: 0.01}, (INPUT, model.LINK)))
    less = full.without(["theta_offset[1]", "theta_offset[2]", INPUT, "theta1", "alpha_backlash"])
    assert less.absent == {"theta_offset", "theta1", "alpha_backlash", "theta_backlash"}
    assert less.timing == Timing("zero", {}, (model.LINK,))
    assert not {"gravity", "link_offset", "backlash"} & {*less.terms}


@pytest.mark.parametrize(
    ("deviation", "free", "known"),
    [(0.049, False, True), (0.051, False, False), (0.01, True, False)],
)
def test_only_a_core_that_is_known_needs_no_ladder(deviation: float, free: bool, known: bool):
    """Assert that inertias and stiffness decide, gravity does not, and none may be undetermined."""
    reduced = SimpleNamespace(free=np.array([False, free]))
    short = SimpleNamespace(
        names=("theta1", "alpha1"),
        values=np.array([1.0, -1.0]),
        unit_deviations=np.array([9.0, deviation]),
        minimum=SimpleNamespace(reduced=reduced),
    )
    assert fitting._is_known(cast(Any, short)) == known


TERMS = ("gravity", "motor_viscous", "motor_coulomb")
STIFF = {"joint_stiffness": 1500.0, "motor_coulomb_up": 2.0, "motor_coulomb_down": 2.0}
FINE_NOISE, COARSE_NOISE = 1e-6, 1e-3  # rad

STRUCTURE = structure(*TERMS, hold="zero")
FINE_START = {**COEFFICIENTS, "theta2": 1500.0, "alpha1": 5000.0, "alpha_coulomb": 2.0 / 0.3}


def recorded(noise: float) -> Recording:
    """Return six seconds with dry friction."""
    return made(4, 6.0, noise=noise, held=True, **STIFF)


@cache
def by_length(noise: float) -> tuple[Fitted, ...]:
    """Return fits to that recording over segments of growing length."""
    own = data(recorded(noise))
    return tuple(fit_by_length(STRUCTURE, own, FINE_START, lengths(own)))


def test_fine_encoders_want_shorter_steps(monkeypatch: pytest.MonkeyPatch):
    """Assert that steps are refined until their error is negligible, and only for fine encoders.

    The longer steps of a rival hold add no doubt about the hold.
    """
    coarse = fitting.with_steps_refined(by_length(COARSE_NOISE))
    assert {fit.data.refinement for fit in coarse} == {1}
    found = by_length(FINE_NOISE)
    times = refinement(found[-1].problem, found[-1].minimum)
    assert times > 1
    fine = fitting.in_own_steps(found[-1])
    assert fitting.with_steps_refined([fine])[0].data.refinement == fine.data.refinement == times
    last = fitting.with_steps_refined(found)[-1]
    segments, states = last.problem.segments, last.minimum.point.initial_states
    fits = [
        refit(STRUCTURE, last.data, last.by_name, segments, tolerance, states)
        for tolerance in (FINE, ROUGH)
    ]
    assert [f.problem.substeps // last.problem.substeps for f in fits] == [times, 1]
    assert refinement(fits[0].problem, fits[0].minimum) == 1
    # The rival has the same hold.
    monkeypatch.setattr(fits_by_length, "with_other_hold", lambda *_: last)
    doubt = np.diag(fits_by_length.hold_covariance(fits[0], ("zero",)))
    unit = fits[0].unit_deviations
    assert np.abs((last.values - fits[0].values) / unit).max() > 1.0
    assert (np.sqrt(doubt) / unit).max() < 0.05


@pytest.mark.parametrize("refined", [False, True])
def test_report_and_rivals_take_the_same_steps(
    refined: bool, monkeypatch: pytest.MonkeyPatch, fits_seen: list[FinalFits]
):
    """Assert that the final fit has the chosen fit's steps or finer, and the full fit the same."""
    times = []

    def watched(structure, data, *rest):
        times.append(data.refinement)
        return fit_to(structure, data, *rest)

    monkeypatch.setattr(final, "fit_to", watched)
    if not refined:
        monkeypatch.setattr(fits_by_length, "with_steps_refined", tuple)
    given = Settings(terms=TERMS, hold="zero", input_delay=0.0, link_delay=0.0)
    identify([log(recorded(FINE_NOISE))], given)
    (found,) = fits_seen
    assert (found.choice.fitted.data.refinement > 1) == (min(times) > 1) == refined
    assert found.reported.data.refinement > 1
    assert found.full.problem.substeps == found.reported.problem.substeps
