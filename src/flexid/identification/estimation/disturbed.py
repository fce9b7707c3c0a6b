"""Fit with disturbances, in the joint's band, of a log that the model does not explain.

Each row has a disturbance for all that no term describes (see `flexid.estimators.innovations`). So
errors of one row do not affect the other. The fit assumes random disturbances. Systematic parts
widen the intervals in `flexid.identification.estimation.disturbed_estimate`.
"""

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import chain, islice

import numpy as np

from flexid.errors import ConvergenceError
from flexid.estimators.channel_timing import Timing
from flexid.estimators.samples import side_by_side
from flexid.estimators.steady_gains import Sizes
from flexid.identification.estimation.band import (
    FitInBand,
    directions,
    fit_in_band,
    noise_in_band,
    observer_following,
    thinned,
    thinning,
)
from flexid.identification.full_model.fits_by_length import only_brakes
from flexid.identification.full_model.fitting import lengths
from flexid.identification.full_model.model import LINK, Data, Fitted, Structure
from flexid.identification.full_model.starting import no_start, starts
from flexid.identification.structure.elimination import eliminate, latest
from flexid.identification.structure.gap import (
    CHANCE,
    LIKELIER,
    LikelyPlay,
    following,
    half_gap,
    is_dead_zone,
    likely_play,
    met,
    width_of,
)
from flexid.identification.structure.link_delay import is_damping, shifted, skew
from flexid.identification.structure.validation import Follower
from flexid.identification.vocabulary.evidence import TermEvidence
from flexid.identification.vocabulary.thresholds import Thresholds
from flexid.models.flexible_joint import (
    DISSIPATIVE,
    HARDENING,
    HYSTERESIS_GRIP,
    SHAPE_TERMS,
    SPRING,
    TERMS,
    flexible_joint,
)
from flexid.recording.recording import Hold

_ROUNDS = 3  # of removing terms
# Largest ratio of unexplained shares after and before terms are removed. It was up to 1.2 for 15
# logs, and 2.1 and 4.5 for two short logs that had lost a friction or the spring.
_CLEARLY_MORE = 1.5
# Coefficients of the spring in the link's row, and those in the motor's row.
_MOTOR_OF_LINK = {SPRING[0]: SPRING[1]} | {
    link: motor
    for term in (TERMS["cubic_stiffness"], SHAPE_TERMS["backlash"])
    for link, motor in zip(term.link, term.motor, strict=True)
}
# Least relative increase of the stiffness by play; less may be due to an encoder's steps.
_LEAST_STIFFER = 0.02
_WIDTHS = 5  # most fits until the width of play equals its gap
# Unexplained share of a balance above which the fit of all terms may be in a wrong minimum. On 6 of
# 17 logs of unusual rigs, a start from few terms led to a likelier fit.
_WRONG_MINIMUM = 0.5
_SKEWED = 0.5  # least share of the deflection's variance that a start with a delay explains


@dataclass(frozen=True, eq=False)
class Disturbed:
    """Structure fitted with disturbances."""

    fitted: Fitted  # fit of the thinned log, with innovations as residuals
    full: Fitted  # fit with all usual terms
    terms: tuple[TermEvidence, ...]  # evidence on each term
    sizes: Sizes  # sizes of noise and disturbances
    # root mean square of each balance's unexplained part over its acceleration
    shares: Mapping[str, float]
    factor: int  # thinning factor
    cost: float  # -2 log likelihood
    by_play: float = 0.0  # relative increase of the stiffness with play instead of hardening
    by_lost_play: float = 0.0  # relative increase by play that was likely but was removed later


def fit_disturbed(
    structure: Structure,
    data: Data,
    kept: Collection[str],
    holds: Sequence[Hold],
    thresholds: Thresholds,
    *,
    with_shapes: bool,
) -> Disturbed:
    """Fit all usual terms, and play or hysteresis if likely; remove terms that are not shown."""
    factor = thinning(data, _start(structure, data))
    if LINK in structure.timing.sought:
        skewed = skew(structure.joint, thinned(data, factor, held=False))
        if skewed.makes_the_deflection:  # the log then shows neither spring nor play
            with_shapes = False
            timing = _with_link_delay(structure.timing, skewed.delay)
            # A cubic spring would soften until the motion diverges.
            structure = replace(structure.without(HARDENING - {*kept}), timing=timing)
            factor = thinning(data, _start(structure, data))
    # A low-passed input has no steps, so hold and delay are indistinguishable.
    tried = [structure.with_hold(hold) for hold in (holds if factor == 1 else holds[:1])]
    full = _likeliest(tried, data, factor)
    if max(_shares(full.fitted, full.sizes).values()) > _WRONG_MINIMUM:
        full = min([full, *_from_few_terms(full, data, factor)], key=_cost)
    likely = None if structure.joint.kind == "rigid" else likely_play(full.fitted.structure, data)
    played, by_play, lost = full, likely.doubt if likely else 0.0, 0.0
    if likely and with_shapes:
        played, by_play = _with_play(full, likely, data, factor)
        lost = 0.0 if played is full else by_play
    if with_shapes:
        full = min((played, *_with_hysteresis(full, data, factor)), key=_cost)
        if full is not played:  # hysteresis explains what looked like play
            by_play, lost = 0.0, 0.0
    best, evidence = _with_shown_terms(full, data, factor, kept, thresholds)
    if is_damping(best.fitted.by_name):  # delay and friction are equivalent to one damping
        without = structure.without({LINK})
        return fit_disturbed(without, data, kept, holds, thresholds, with_shapes=with_shapes)
    best = _as_wide_as_its_gap(best, data, factor)
    shares = _shares(best.fitted, best.sizes)
    rest = factor, best.cost, by_play, lost
    return Disturbed(best.fitted, full.fitted, evidence, best.sizes, shares, *rest)


def _likeliest(tried: Sequence[Structure], data: Data, factor: int) -> FitInBand:
    """Return the likeliest fit of several structures from least-squares starts.

    If the motion diverges from all of these, further starts are tried.
    """
    begun = (
        (structure, start)
        for structure in tried
        for start in _starts(structure, thinned(data, factor, held=structure.timing.hold == "zero"))
    )
    every = side_by_side(lambda start: [*_fits([start], data, factor)], begun)
    found = [*chain.from_iterable(every)]
    if not found:
        others = ((tried[0], start) for start in starts(tried[0], data, lengths(data)[0]))
        found = [*islice(_fits(islice(others, 1, None), data, factor), 1)]
    if not found:
        raise no_start()
    return min(found, key=lambda fit: (not fit.fitted.has_partners, fit.cost))


def _from_few_terms(full: FitInBand, data: Data, factor: int) -> Iterator[FitInBand]:
    """Yield the fit of the full structure started from a fit of the paper's terms alone."""
    structure, of_the_paper = full.fitted.structure, flexible_joint().coefficients
    names = dict.fromkeys(structure.unknowns(data.groups).names, 0.0)
    more = {name for name in names if name.partition("[")[0] not in of_the_paper}
    few = structure.without(more | {*structure.timing.sought})
    for found in _fits([(few, _start(few, data))], data, factor):
        delays = dict.fromkeys(structure.timing.sought, 0.0)
        start = {**names, **delays, **found.fitted.by_name}
        yield from _fits([(structure, start)], data, factor)


def _fits(
    begun: Iterable[tuple[Structure, Mapping[str, float]]], data: Data, factor: int
) -> Iterator[FitInBand]:
    """Yield the fits from starts that converge."""
    for structure, start in begun:
        with suppress(ConvergenceError):
            yield fit_in_band(structure, data, factor, start)


def _with_shown_terms(
    full: FitInBand, data: Data, factor: int, kept: Collection[str], thresholds: Thresholds
) -> tuple[FitInBand, tuple[TermEvidence, ...]]:
    """Return the fit of the terms that the log shows, and the evidence on each term."""
    best, evidence = full, ()
    for chance in (thresholds.term_chance, thresholds.generous_chance):
        asked = replace(thresholds, friction_sign=np.inf, term_chance=chance)
        for _ in range(_ROUNDS):
            # Every drive has friction. Without it, disturbances and inertias take its place.
            leaner, own = eliminate(best.fitted, kept, asked, likely=DISSIPATIVE)
            other = _leaner(leaner, best, data, factor)
            if other is None:
                evidence = latest(evidence, [replace(term, kept=True) for term in own])
                break
            best, evidence = other, latest(evidence, own)
    return best, evidence


def _leaner(leaner: Structure, best: FitInBand, data: Data, factor: int) -> FitInBand | None:
    """Return the fit of a leaner structure; None if not leaner, diverged or clearly worse."""
    before = best.fitted.structure
    if leaner.absent == before.absent and leaner.timing.sought == before.timing.sought:
        return None
    try:
        other = fit_in_band(leaner, data, factor, best.fitted.by_name, best.sizes)
    except ConvergenceError:
        return None
    return None if _is_known(best) and _leaves_more(other, best) else other


def _with_play(
    fit: FitInBand, likely: LikelyPlay, data: Data, factor: int
) -> tuple[FitInBand, float]:
    """Return the fit with play if it is likelier, otherwise the given fit, and the spring's doubt.

    The doubt is the relative increase of the stiffness with play. If neither fit is clearly
    likelier, it is the lesser of the increases by least squares and by the fit.
    """
    if likely.stiffer < _LEAST_STIFFER:
        return fit, likely.doubt
    start = _stiffer(fit.fitted.by_name, likely.start)
    try:
        played = fit_in_band(likely.structure, data, factor, start)
        played = _as_wide_as_its_gap(played, data, factor)
        if played.cost > fit.cost + CHANCE:  # perhaps only since its sizes differ
            structure, start = played.fitted.structure, played.fitted.by_name
            other = fit_in_band(structure, data, factor, start, fit.sizes)
            played = min(played, _as_wide_as_its_gap(other, data, factor), key=_cost)
    except ConvergenceError:
        return fit, likely.doubt
    if played.cost > fit.cost + CHANCE:
        return fit, 0.0
    if not (is_dead_zone(played.fitted) and played.fitted.has_partners):
        return fit, likely.doubt
    stiffer = abs(played.fitted.by_name["theta2"] / fit.fitted.by_name["theta2"] - 1.0)
    if played.cost < fit.cost - CHANCE:
        return played, stiffer
    return fit, min(stiffer, likely.doubt)


def _with_hysteresis(fit: FitInBand, data: Data, factor: int) -> Iterator[FitInBand]:
    """Yield the fit with hysteresis if it brakes, is likelier and explains clearly more."""
    structure, joint = fit.fitted.structure, fit.fitted.structure.joint
    if not joint.remembered or not joint.remembered <= structure.absent:
        return
    structure = replace(structure, absent=structure.absent - joint.remembered)
    start = {**fit.fitted.by_name, HYSTERESIS_GRIP: joint.first[HYSTERESIS_GRIP]}
    for other in _fits([(structure, start)], data, factor):
        left, before = (_shares(each.fitted, each.sizes)["link"] for each in (other, fit))
        explains = other.cost < fit.cost - CHANCE and left**2 < LIKELIER * before**2
        if explains and only_brakes(other.fitted):
            yield other


def _stiffer(values: Mapping[str, float], link: Mapping[str, float]) -> dict[str, float]:
    """Return values with the link's spring by least squares, in both balances."""
    own = {name: link[name] for name in _MOTOR_OF_LINK if name in link}
    if "alpha1" not in values:
        return {**values, **own}
    motor = {alpha: own[theta] for theta, alpha in _MOTOR_OF_LINK.items() if theta in own}
    share = values["alpha1"] / values["theta2"]
    return {**values, **own, **{name: share * value for name, value in motor.items()}}


def _as_wide_as_its_gap(fit: FitInBand, data: Data, factor: int) -> FitInBand:
    """Return the fit with the width of its play equal to its gap, or the last that converged."""
    trail: list[tuple[float, float]] = []
    with suppress(ConvergenceError):
        for _ in range(_WIDTHS):
            gap = half_gap(fit.fitted)
            if gap <= 0.0 or is_dead_zone(fit.fitted):
                break
            trail.append((width_of(fit.fitted.structure), gap))
            structure = following(fit.fitted, met(trail))
            fit = fit_in_band(structure, data, factor, fit.fitted.by_name, fit.sizes)
    return fit


def _cost(fit: FitInBand) -> float:
    return fit.cost


def _is_known(fit: FitInBand) -> bool:
    """Whether the fit converged, and a short log has enough blocks for all terms."""
    return fit.fitted.converged and bool(np.isfinite(fit.fitted.fit.deviations).all())


def _leaves_more(leaner: FitInBand, fuller: FitInBand) -> bool:
    """Whether the leaner fit is less likely and leaves clearly more unexplained.

    Both are required. A fit may be in a wrong minimum whose sizes explain all motion as noise.
    """
    before, after = (
        # If no sizes fit the residuals, innovations are larger than the sizes predict.
        sum(_shares(f.fitted, f.sizes).values()) * f.fitted.excess**0.5
        for f in (fuller, leaner)
    )
    return leaner.cost > fuller.cost and after > _CLEARLY_MORE * before


def fit_disturbed_to(found: Disturbed, data: Data) -> Disturbed:
    """Fit the same structures to other data of the same drive."""
    structure, factor = found.fitted.structure, found.factor
    own = fit_in_band(structure, data, factor, found.fitted.by_name, found.sizes)
    own = _as_wide_as_its_gap(own, data, factor)
    full = found.full  # used for hidden terms if the full fit to these data fails
    with suppress(ConvergenceError):
        fuller = fit_in_band(full.structure, data, factor, full.by_name, own.sizes)
        if not fuller.fitted.converged:  # its values of removed terms would be wrong
            other = fit_in_band(full.structure, data, factor, own.fitted.by_name, own.sizes)
            fuller = min(fuller, other, key=_cost)
        full = fuller.fitted
        if _leaves_more(own, fuller):  # a wrong minimum, since it was not worse before
            other = fit_in_band(structure, data, factor, full.by_name, fuller.sizes)
            own = min(own, other, key=_cost)
    shares = _shares(own.fitted, own.sizes)
    rest = {"sizes": own.sizes, "shares": shares, "cost": own.cost}
    return replace(found, fitted=own.fitted, full=full, **rest)


def follower(found: Disturbed, data: Data) -> Follower:
    """Return a follower that predicts a log as recorded from the states of the fit's observer."""
    directed = directions(data.samples, 1, found.factor)
    return observer_following(directed, found.sizes, found.factor)


def _start(structure: Structure, data: Data) -> dict[str, float]:
    return next(starts(structure, data, lengths(data)[0]))


def _starts(structure: Structure, data: Data) -> Iterator[dict[str, float]]:
    """Yield least-squares starts: with the channels as logged, and with the encoders aligned."""
    yield _start(structure, data)
    if LINK not in structure.timing.sought or structure.joint.kind != "flexible":
        return
    found = skew(structure.joint, data)
    if found.explained > _SKEWED and abs(found.delay) < data.margin:
        yield {**_start(structure, shifted(data, found.delay)), LINK: found.delay}


def _with_link_delay(timing: Timing, link_delay: float) -> Timing:
    """Return the timing with the delay of the link's encoder given."""
    sought = tuple(name for name in timing.sought if name != LINK)
    return replace(timing, delays={**timing.delays, LINK: link_delay}, sought=sought)


def _shares(fitted: Fitted, sizes: Sizes) -> dict[str, float]:
    """Return each balance's unexplained share: disturbance and sensor errors beyond noise."""
    data, segments = fitted.data, fitted.problem.segments
    squares, count = np.zeros(len(sizes.disturbances)), 0
    for samples in data.samples:
        assert samples.velocities is not None
        rates = np.gradient(samples.velocities, samples.sample_time, axis=0)
        squares, count = squares + np.sum(rates**2, axis=0), count + len(rates)
    shares = sizes.disturbances**2 * count / np.maximum(squares, np.finfo(float).tiny)
    joint = fitted.structure.joint
    if joint.kind != "rigid":
        moved = np.var(joint.channels_of(segments.outputs, segments.inputs)[:, -1])
        # An error of either position acts on both rows through the spring.
        beyond = np.sum(np.maximum(sizes.sensors**2 - noise_in_band(data) ** 2, 0.0))
        shares = shares + beyond / max(float(moved), np.finfo(float).tiny)
    names = [_side(row.name) for row in fitted.problem.unknowns.system.rows]
    return dict(zip(names, np.minimum(np.sqrt(shares), 1.0).tolist(), strict=True))


def _side(row: str) -> str:
    """Return the side that a row is the balance of."""
    return "motor" if row == "rigid" else row
