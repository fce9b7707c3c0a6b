"""The fit of a log that the model does not explain: with disturbances, in the joint's band.

What no term describes acts as a disturbance of its row (see `flexid.estimators.innovations`), so
that neither row spoils the other. A disturbance is taken to be random; what is not random about it
is doubted in `flexid.identification.estimation.disturbed_estimate`.
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
from flexid.identification.full_model.fitting import lengths
from flexid.identification.full_model.model import LINK, Data, Fitted, Structure
from flexid.identification.full_model.starting import no_start, starts
from flexid.identification.structure.elimination import eliminate, latest
from flexid.identification.structure.gap import (
    CHANCE,
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
    SHAPE_TERMS,
    SPRING,
    TERMS,
    flexible_joint,
)
from flexid.recording.recording import Hold

_ROUNDS = 3  # of taking terms away
# Of what both balances left unexplained before: leaner structures of 15 logs left up to 1.2 times
# as much, and those of two short ones that had lost a friction or the spring 2.1 and 4.5 times.
_NO_MORE = 1.5
# What a spring does to the link, and the same to the motor.
_OF_LINK = {SPRING[0]: SPRING[1]} | {
    link: motor
    for term in (TERMS["cubic_stiffness"], SHAPE_TERMS["backlash"])
    for link, motor in zip(term.link, term.motor, strict=True)
}
# Share by which play makes the spring stiffer: with less it is no more than an encoder's steps.
_LEAST_STIFFER = 0.02
_WIDTHS = 5  # of play, until it is as wide as its gap
# Of a balance's acceleration, that a fit leaves unexplained which may have gone astray with all
# terms. Of 17 logs of odd rigs, a start of few terms led six to a likelier fit.
_ASTRAY = 0.5
_SKEWED = 0.5  # share of the deflection's variance that a delay explains, to begin with it


@dataclass(frozen=True, eq=False)
class Disturbed:
    """A structure fitted with disturbances."""

    fitted: Fitted  # innovations of the thinned log; values as in a fit of the whole log
    full: Fitted  # the same with all usual terms
    terms: tuple[TermEvidence, ...]  # what was kept and what was not
    sizes: Sizes  # of noise and disturbances
    # what each row leaves unexplained over its acceleration, root mean squares
    shares: Mapping[str, float]
    factor: int  # of so many samples of the log one was fitted
    cost: float  # twice the negative logarithm of the likelihood
    by_play: float = 0.0  # share by which its spring is stiffer if it has play and does not curve
    by_lost_play: float = 0.0  # the same of play that was likelier than none, if it did not stay


def fit_disturbed(
    structure: Structure,
    data: Data,
    kept: Collection[str],
    holds: Sequence[Hold],
    thresholds: Thresholds,
    *,
    with_play: bool,
) -> Disturbed:
    """Fit all usual terms, and play if it is likely; take away what the log does not show."""
    factor = thinning(data, _start(structure, data))
    if LINK in structure.timing.sought:
        skewed = skew(structure.joint, thinned(data, factor, held=False))
        if skewed.makes_the_deflection:  # and a spring may be anything, with any play
            with_play = False
            structure = replace(structure, timing=_given(structure.timing, skewed.delay))
            factor = thinning(data, _start(structure, data))
    # A low-passed input has no steps; how it runs between samples and its delay look alike.
    tried = [structure.with_hold(hold) for hold in (holds if factor == 1 else holds[:1])]
    full = _likeliest(tried, data, factor)
    if max(_shares(full.fitted, full.sizes).values()) > _ASTRAY:
        full = min([full, *_from_the_papers_terms(full, data, factor)], key=_cost)
    likely = None if structure.joint.kind == "rigid" else likely_play(full.fitted.structure, data)
    by_play, lost = likely.doubt if likely else 0.0, 0.0
    if likely and with_play:
        played, by_play = _with_play(full, likely, data, factor)
        full, lost = played, 0.0 if played is full else by_play
    best, evidence = _without_what_is_not_shown(full, data, factor, kept, thresholds)
    if is_damping(best.fitted.by_name):  # which one coefficient says as well as two
        without = structure.without({LINK})
        return fit_disturbed(without, data, kept, holds, thresholds, with_play=with_play)
    best = _as_wide_as_its_gap(best, data, factor)
    shares = _shares(best.fitted, best.sizes)
    rest = factor, best.cost, by_play, lost
    return Disturbed(best.fitted, full.fitted, evidence, best.sizes, shares, *rest)


def _likeliest(tried: Sequence[Structure], data: Data, factor: int) -> FitInBand:
    """The likeliest fit of any structure from where least squares begins.

    Where the motion runs away from there, it may not from the next start.
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


def _from_the_papers_terms(full: FitInBand, data: Data, factor: int) -> Iterator[FitInBand]:
    """The same structure from where the few terms of the paper lead, if they do."""
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
    """Fits from starts, as far as these lead anywhere."""
    for structure, start in begun:
        with suppress(ConvergenceError):
            yield fit_in_band(structure, data, factor, start)


def _without_what_is_not_shown(
    full: FitInBand, data: Data, factor: int, kept: Collection[str], thresholds: Thresholds
) -> tuple[FitInBand, tuple[TermEvidence, ...]]:
    """The fit of the terms that the log shows, and what it says of each."""
    best, evidence = full, ()
    for chance in (thresholds.term_chance, thresholds.generous_chance):
        asked = replace(thresholds, friction_sign=np.inf, term_chance=chance)
        for _ in range(_ROUNDS):
            # Every drive has friction. Left out, disturbances and inertias take its part.
            leaner, own = eliminate(best.fitted, kept, asked, likely=DISSIPATIVE)
            other = _leaner(leaner, best, data, factor)
            if other is None:
                evidence = latest(evidence, [replace(term, kept=True) for term in own])
                break
            best, evidence = other, latest(evidence, own)
    return best, evidence


def _leaner(leaner: Structure, best: FitInBand, data: Data, factor: int) -> FitInBand | None:
    """The fit of a leaner structure; None if it is none, runs away or leaves clearly more."""
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
    """A fit with play, where the log finds it likelier, or as it is; and the doubt of its spring.

    The doubt is the share by which the spring is stiffer with play. Where the log does not say, it
    is that by least squares or by the fit, whichever is less.
    """
    if likely.stiffer < _LEAST_STIFFER:
        return fit, likely.doubt
    start = _stiffer(fit.fitted.by_name, likely.start)
    try:
        played = fit_in_band(likely.structure, data, factor, start)
        played = _as_wide_as_its_gap(played, data, factor)
        if played.cost > fit.cost + CHANCE:  # perhaps by other sizes alone
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


def _stiffer(values: Mapping[str, float], link: Mapping[str, float]) -> dict[str, float]:
    """Values with the spring that least squares finds for the link, in both balances."""
    own = {name: link[name] for name in _OF_LINK if name in link}
    if "alpha1" not in values:
        return {**values, **own}
    motor = {alpha: own[theta] for theta, alpha in _OF_LINK.items() if theta in own}
    share = values["alpha1"] / values["theta2"]
    return {**values, **own, **{name: share * value for name, value in motor.items()}}


def _as_wide_as_its_gap(fit: FitInBand, data: Data, factor: int) -> FitInBand:
    """The same with play that has the width of its own gap, if it has some that leads there."""
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
    """Whether steps ended, and blocks are enough for all terms: in a short log they are few."""
    return fit.fitted.converged and bool(np.isfinite(fit.fitted.fit.deviations).all())


def _leaves_more(leaner: FitInBand, fuller: FitInBand) -> bool:
    """Whether the balances without some terms leave clearly more, and the log is less likely.

    Sizes that explain all as noise are a minimum of their own, from which fewer terms may lead out.
    """
    before, after = (
        # Where no sizes suit what is left, innovations are larger than these say.
        sum(_shares(f.fitted, f.sizes).values()) * f.fitted.excess**0.5
        for f in (fuller, leaner)
    )
    return leaner.cost > fuller.cost and after > _NO_MORE * before


def fit_disturbed_to(found: Disturbed, data: Data) -> Disturbed:
    """The same structures fitted to other data of the same drive."""
    structure, factor = found.fitted.structure, found.factor
    own = fit_in_band(structure, data, factor, found.fitted.by_name, found.sizes)
    own = _as_wide_as_its_gap(own, data, factor)
    full = found.full  # which says what may hide, with two thirds of the data if need be
    with suppress(ConvergenceError):
        fuller = fit_in_band(full.structure, data, factor, full.by_name, own.sizes)
        if not fuller.fitted.converged:  # what it says of terms that may hide is far off
            other = fit_in_band(full.structure, data, factor, own.fitted.by_name, own.sizes)
            fuller = min(fuller, other, key=_cost)
        full = fuller.fitted
        if _leaves_more(own, fuller):  # which it did not before: it went astray
            other = fit_in_band(structure, data, factor, full.by_name, fuller.sizes)
            own = min(own, other, key=_cost)
    shares = _shares(own.fitted, own.sizes)
    rest = {"sizes": own.sizes, "shares": shares, "cost": own.cost}
    return replace(found, fitted=own.fitted, full=full, **rest)


def follower(found: Disturbed, data: Data) -> Follower:
    """Predictions of a log, as it was recorded, from where the observer of a fit has got to."""
    directed = directions(data.samples, 1, found.factor)
    return observer_following(directed, found.sizes, found.factor)


def _start(structure: Structure, data: Data) -> dict[str, float]:
    return next(starts(structure, data, lengths(data)[0]))


def _starts(structure: Structure, data: Data) -> Iterator[dict[str, float]]:
    """Where to begin: least squares, with the channels as they are, and as a skew puts them."""
    yield _start(structure, data)
    if LINK not in structure.timing.sought or structure.joint.kind != "flexible":
        return
    found = skew(structure.joint, data)
    if found.explained > _SKEWED and abs(found.delay) < data.margin:
        yield {**_start(structure, shifted(data, found.delay)), LINK: found.delay}


def _given(timing: Timing, link_delay: float) -> Timing:
    """The same with the delay of the link's encoder given."""
    sought = tuple(name for name in timing.sought if name != LINK)
    return replace(timing, delays={**timing.delays, LINK: link_delay}, sought=sought)


def _shares(fitted: Fitted, sizes: Sizes) -> dict[str, float]:
    """What each row leaves unexplained: its disturbance, and errors of its sensor beyond noise."""
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
        # Through the spring an error of either position acts on both rows.
        beyond = np.sum(np.maximum(sizes.sensors**2 - noise_in_band(data) ** 2, 0.0))
        shares = shares + beyond / max(float(moved), np.finfo(float).tiny)
    names = [_name(row.name) for row in fitted.problem.unknowns.system.rows]
    return dict(zip(names, np.minimum(np.sqrt(shares), 1.0).tolist(), strict=True))


def _name(row: str) -> str:
    """The side that a row is the balance of."""
    return "motor" if row == "rigid" else row
