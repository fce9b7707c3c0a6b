"""Fit with disturbances, in the joint's band, of a log that the model does not explain.

Each row has a disturbance for all that no term describes (see `flexid.estimators.innovations`). So
errors of one row do not affect the other. The fit assumes random disturbances. Systematic parts
widen the intervals in `flexid.identification.estimation.disturbed_estimate`.
"""

from collections.abc import Collection, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from flexid.errors import ConvergenceError
from flexid.estimators.samples import side_by_side
from flexid.identification.estimation.band import (
    Band,
    JointInBand,
    cost_of,
    directions_on_time,
    observer_following,
)
from flexid.identification.estimation.input_noise import InputChoice, likelier_input
from flexid.identification.estimation.thinned_log import thinned, thinning
from flexid.identification.estimation.unusual_terms import (
    with_hysteresis,
    with_play,
    with_shape,
    with_width_of_gap,
)
from flexid.identification.full_model.fitting import lengths
from flexid.identification.full_model.model import LINK, Data, Fitted, Structure
from flexid.identification.full_model.starting import no_start, starts
from flexid.identification.structure.elimination import eliminate, latest
from flexid.identification.structure.gap import likely_play
from flexid.identification.structure.link_delay import is_damping, shifted, skew
from flexid.identification.structure.sought_terms import (
    BEND,
    LINEAR,
    LOADED,
    PARALLEL,
    PRESLIDING,
    PROGRESSIVE,
    RIPPLE,
    SATURATING,
    SCALES,
    STRIBECK,
    TRANSMISSION,
)
from flexid.identification.structure.validation import Follower
from flexid.identification.vocabulary.evidence import TermEvidence
from flexid.identification.vocabulary.thresholds import Thresholds
from flexid.models.flexible_joint import DAMPING, DISSIPATIVE, HARDENING, flexible_joint
from flexid.recording.recording import Hold

_ROUNDS = 3  # of removing terms
# Largest ratio of an unexplained share after and before terms are removed. It was up to 1.2 for 15
# logs, and 2.1 and 4.5 for two short logs that had lost a friction or the spring.
_CLEARLY_MORE = 1.5
_SMALL_SHARE = 0.02  # unexplained share below which a balance is as good as explained
# Unexplained share of a balance above which the fit of all terms may be in a wrong minimum. On 6 of
# 17 logs of unusual rigs, a start from few terms led to a likelier fit.
_WRONG_MINIMUM = 0.5
_SKEWED = 0.5  # least share of the deflection's variance that a start with a delay explains


@dataclass(frozen=True, eq=False)
class Disturbed:
    """Structure fitted with disturbances."""

    best: JointInBand  # fit of the thinned log
    full: Fitted  # fit with all usual terms
    terms: tuple[TermEvidence, ...]  # evidence on each term
    by_play: float  # relative increase of the stiffness with play instead of hardening
    input: InputChoice

    @property
    def fitted(self) -> Fitted:
        """Fit of the thinned log, with innovations as residuals."""
        return self.best.fitted


def fit_disturbed(
    structure: Structure,
    data: Data,
    kept: Collection[str],
    holds: Sequence[Hold],
    thresholds: Thresholds,
    *,
    with_shapes: bool,
) -> Disturbed:
    """Fit all usual terms, and unusual ones if likely; remove terms that are not shown."""
    factor = thinning(data, _start(structure, data))
    if LINK in structure.timing.sought:
        skewed = skew(structure.joint, thinned(data, factor, held=False))
        if skewed.makes_the_deflection:  # the log then shows neither spring nor play
            with_shapes = False
            # A cubic spring would soften until the motion diverges.
            structure = structure.without({LINK, *HARDENING} - {*kept})
            delays = {**structure.timing.delays, LINK: skewed.delay}
            structure = replace(structure, timing=replace(structure.timing, delays=delays))
            factor = thinning(data, _start(structure, data))
    # A low-passed input has no steps, so hold and delay are indistinguishable.
    tried = [structure.with_hold(hold) for hold in (holds if factor == 1 else holds[:1])]
    full = _likeliest(tried, Band(data, factor))
    if max(full.shares.values()) > _WRONG_MINIMUM:
        full = min([full, *_from_few_terms(full)], key=cost_of)
    full, chosen = likelier_input(full)
    if with_shapes:
        full, by_play = _with_unusual_terms(full, kept)
    else:
        by_play = _doubtful_play(full)
    # Each unusual term has made the fit clearly likelier. A test of its value alone has less power
    # if it has a constant: a hysteresis and its reach may be inseparable.
    own = full.fitted.structure
    stays = {*kept, *(own.joint.shapes - own.absent - LINEAR)}
    best, evidence = _with_shown_terms(full, stays, thresholds)
    if is_damping(best.fitted.by_name):  # delay and friction are equivalent to one damping
        without = structure.without({LINK})
        return fit_disturbed(without, data, kept, holds, thresholds, with_shapes=with_shapes)
    return Disturbed(with_width_of_gap(best), full.fitted, evidence, by_play, chosen)


def _with_unusual_terms(full: JointInBand, kept: Collection[str]) -> tuple[JointInBand, float]:
    """Return the fit with all unusual terms that are likely, and the spring's doubt by play."""
    # Changes of the torque hide all other terms, a transmission error all laws of the spring.
    for shape in (SATURATING, RIPPLE, TRANSMISSION):
        full = with_shape(shape, full, kept)
    # Different scales of the encoders look like a spring to the base.
    full = min([full, *(with_shape(one, full, kept) for one in (SCALES, PARALLEL))], key=cost_of)
    # Friction of the load hides which spring the motor's balance shows, and the other way round.
    full = with_shape(LOADED, full, kept)
    likely = likely_play(full.fitted.structure, full.band.data)
    played, by_play = with_play(full, likely) if likely else (full, 0.0)
    bent = with_shape(BEND, full, kept)
    stiffening = with_shape(PROGRESSIVE, full, kept)
    best = min((played, bent, stiffening, *with_hysteresis(full)), key=cost_of)
    if best is not played:  # another law explains what looked like play
        by_play = 0.0
    if best is bent and bent is not full:  # a bent spring may have hysteresis as well
        best = min([best, *with_hysteresis(best)], key=cost_of)
    best = with_shape(LOADED, best, kept)
    falling = with_shape(STRIBECK, best, kept)
    best = with_shape(PRESLIDING, falling, kept)
    if best is not falling:  # presliding may have hidden that friction falls
        best = with_shape(STRIBECK, best, kept)
    return best, by_play


def _doubtful_play(full: JointInBand) -> float:
    """Return the relative increase of the stiffness by play that a flexible joint may have."""
    structure = full.fitted.structure
    rigid = structure.joint.kind == "rigid"
    likely = None if rigid else likely_play(structure, full.band.data)
    return likely.doubt if likely else 0.0


def _likeliest(tried: Sequence[Structure], band: Band) -> JointInBand:
    """Return the likeliest fit of several structures from least-squares starts."""
    begun = (
        (structure, start)
        for structure in tried
        for own in [thinned(band.data, band.factor, held=structure.timing.hold == "zero")]
        for start in _starts(structure, own)
    )
    every = side_by_side(lambda start: [*band.fits([start])], begun)
    found = [*chain.from_iterable(every)]
    if not found:
        raise no_start()
    return min(found, key=lambda fit: (not fit.fitted.has_partners, fit.cost))


def _from_few_terms(full: JointInBand) -> Iterator[JointInBand]:
    """Yield the fit of the full structure started from a fit of the paper's terms alone."""
    structure, of_the_paper = full.fitted.structure, flexible_joint().coefficients
    data = full.band.data
    names = dict.fromkeys(structure.unknowns(data.groups).names, 0.0)
    more = {name for name in names if name.partition("[")[0] not in of_the_paper}
    if more >= names.keys():  # the inertia of a rigid joint is given
        return
    few = structure.without(more | {*structure.timing.sought})
    for found in full.band.fits([(few, _start(few, data))]):
        delays = dict.fromkeys(structure.timing.sought, 0.0)
        start = {**names, **delays, **found.fitted.by_name}
        yield from full.band.fits([(structure, start)])


def _with_shown_terms(
    full: JointInBand, kept: Collection[str], thresholds: Thresholds
) -> tuple[JointInBand, tuple[TermEvidence, ...]]:
    """Return the fit of the terms that the log shows, and the evidence on each term."""
    best, evidence = full, ()
    for chance in (thresholds.term_chance, thresholds.generous_chance):
        asked = replace(thresholds, friction_sign=np.inf, term_chance=chance)
        for _ in range(_ROUNDS):
            before, (best, own) = best, _without_hidden_terms(best, kept, asked)
            evidence = latest(evidence, own)
            if best is before:
                break
    return best, evidence


def _without_hidden_terms(
    best: JointInBand, kept: Collection[str], asked: Thresholds
) -> tuple[JointInBand, Sequence[TermEvidence]]:
    """Return the fit without terms that the log does not show, or `best`, and the evidence."""
    # The log shows terms of an undetermined direction together, such as an offset and the dry
    # friction of a side that turns one way. They may be needed although it shows none of them.
    together = {name for name, free in zip(best.fitted.names, _free(best), strict=True) if free}
    own: Sequence[TermEvidence] = ()
    for stay in ({*kept}, {*kept} | together):
        # Every drive has friction. Without it, disturbances and inertias take its place. Damping of
        # the spring is no such friction, and what no term describes often looks like it.
        leaner, own = eliminate(best.fitted, stay, asked, likely=DISSIPATIVE - DAMPING)
        other = _leaner(leaner, best)
        if other is not None:
            return other, own
        if not together:
            break
    return best, [replace(term, kept=True) for term in own]


def _free(fit: JointInBand) -> NDArray[np.bool_]:
    """Return a mask of values with a component in an undetermined direction."""
    return fit.fitted.minimum.reduced.free


def _leaner(leaner: Structure, best: JointInBand) -> JointInBand | None:
    """Return the fit of a leaner structure; None if not leaner, diverged or clearly worse."""
    before = best.fitted.structure
    if leaner.absent == before.absent and leaner.timing.sought == before.timing.sought:
        return None
    try:
        other = best.band.fit(leaner, best.fitted.by_name, best.sizes)
    except ConvergenceError:
        return None
    return None if _is_known(best) and _leaves_more(other, best) else other


def _is_known(fit: JointInBand) -> bool:
    """Whether the fit converged, and a short log has enough blocks for all terms."""
    known = np.isfinite(fit.fitted.fit.deviations) | _free(fit)
    return fit.fitted.converged and bool(known.all())


def _leaves_more(leaner: JointInBand, fuller: JointInBand) -> bool:
    """Whether the leaner fit is less likely and leaves clearly more unexplained."""
    # Both are required. A fit may be in a wrong minimum whose sizes explain all motion as noise.
    before, after = (
        # If no sizes fit the residuals, innovations are larger than the sizes predict.
        {side: share * fit.fitted.excess**0.5 for side, share in fit.shares.items()}
        for fit in (fuller, leaner)
    )
    # The balances count one by one: one that is unexplained anyway would hide the other.
    left = (after[side] > _CLEARLY_MORE * max(before[side], _SMALL_SHARE) for side in before)
    return leaner.cost > fuller.cost and any(left)


def fit_disturbed_to(found: Disturbed, data: Data) -> Disturbed:
    """Fit the same structures to other data of the same drive, as logged."""
    band, structure = replace(found.best.band, data=found.input.of(data)), found.fitted.structure
    own = with_width_of_gap(band.fit(structure, found.fitted.by_name, found.best.sizes))
    full = found.full  # used for hidden terms if the full fit to these data fails
    with suppress(ConvergenceError):
        fuller = band.fit(full.structure, full.by_name, own.sizes)
        # Values of removed terms are wrong without convergence, or in a wrong minimum.
        if not fuller.fitted.converged or fuller.cost > own.cost:
            other = band.fit(full.structure, own.fitted.by_name, own.sizes)
            fuller = min(fuller, other, key=cost_of)
        full = fuller.fitted
        if _leaves_more(own, fuller):  # a wrong minimum, since it was not worse before
            other = band.fit(structure, full.by_name, fuller.sizes)
            own = min(own, other, key=cost_of)
    return replace(found, best=own, full=full)


def follower(found: Disturbed, data: Data) -> Follower:
    """Return a follower that predicts a log as recorded from the states of the fit's observer."""
    late, factor = found.fitted.delays.get(LINK, 0.0), found.best.band.factor
    directed = directions_on_time(data, late, 1, factor)
    return observer_following(directed, found.best.sizes, factor)


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
