"""Unusual terms in fits with disturbances: of transmission, spring and the motor's friction.

Each is a law that the usual terms describe badly. It is kept if the fit becomes likelier and
explains clearly more of the balance that the law belongs to.
"""

from collections.abc import Collection, Iterator, Mapping
from contextlib import suppress
from dataclasses import replace

import numpy as np

from flexid.errors import ConvergenceError
from flexid.estimators.samples import side_by_side
from flexid.identification.estimation.band import JointInBand, cost_of
from flexid.identification.full_model.fits_by_length import FOLLOWED
from flexid.identification.full_model.fitting import expanded
from flexid.identification.full_model.model import Fitted, Structure
from flexid.identification.structure.gap import (
    CHANCE,
    LIKELIER,
    LikelyPlay,
    following,
    half_gap,
    is_dead_zone,
    met,
    width_of,
    with_other_damping,
)
from flexid.identification.structure.shapes import SoughtShape
from flexid.identification.structure.sought_terms import HYSTERETIC
from flexid.models.flexible_joint import HYSTERESIS, HYSTERESIS_GRIP, SHAPE_TERMS, SPRING, TERMS

# Coefficients of the spring in the link's row, and those in the motor's row.
_MOTOR_OF_LINK = {SPRING[0]: SPRING[1]} | {
    link: motor
    for term in (TERMS["cubic_stiffness"], SHAPE_TERMS["backlash"])
    for link, motor in zip(term.link, term.motor, strict=True)
}
# Least relative increase of the stiffness by play; less may be due to an encoder's steps.
_LEAST_STIFFER = 0.02
# Ratio of a link's unexplained squared acceleration with and without play, up to which play is a
# doubt even if its fit is worse. At 0.02, with a gap of 3 mrad, the stiffness was 6 % wrong.
_CLEAR = 0.25
# Least share of the innovations' weighted squares that a step with a further term must remove. In
# 48 logs all terms that stayed had 0.023 or more, and nine of 0.011 or less were removed later.
_LEAST_PROMISED = 0.02
_WIDTHS = 5  # most fits until the width of play equals its gap


def with_play(fit: JointInBand, likely: LikelyPlay) -> tuple[JointInBand, float]:
    """Return the fit with play if it is likelier, otherwise the given fit, and the spring's doubt.

    The doubt is the relative increase of the stiffness with play. If neither fit is clearly
    likelier, it is the lesser of the increases by least squares and by the fit.
    """
    if likely.stiffer < _LEAST_STIFFER:
        return fit, likely.doubt
    start, band = _stiffer(fit.fitted.by_name, likely.start), fit.band
    try:
        played = with_width_of_gap(band.fit(likely.structure, start))
        laws = [(law, played.fitted.by_name) for law in with_other_damping(played.fitted.structure)]
        played = min([played, *map(with_width_of_gap, band.fits(laws))], key=cost_of)
        if played.cost > fit.cost + CHANCE:  # perhaps only since its sizes differ
            other = band.fit(played.fitted.structure, played.fitted.by_name, fit.sizes)
            played = min(played, with_width_of_gap(other), key=cost_of)
    except ConvergenceError:
        return fit, likely.doubt
    if played.cost > fit.cost + CHANCE:  # unless least squares is clear, the log denies play
        return fit, likely.doubt if likely.left < _CLEAR else 0.0
    if not (is_dead_zone(played.fitted) and played.fitted.has_partners):
        return fit, likely.doubt
    stiffer = abs(played.fitted.by_name["theta2"] / fit.fitted.by_name["theta2"] - 1.0)
    if played.cost < fit.cost - CHANCE:
        return played, stiffer
    return fit, min(stiffer, likely.doubt)


def with_hysteresis(fit: JointInBand) -> Iterator[JointInBand]:
    """Yield the fit with hysteresis if it brakes, is likelier and explains clearly more."""
    structure, joint = fit.fitted.structure, fit.fitted.structure.joint
    if HYSTERESIS.isdisjoint(joint.shapes) or HYSTERETIC.is_in(fit.fitted):
        return
    structure = replace(structure, absent=structure.absent - HYSTERESIS)
    start = {**fit.fitted.by_name, HYSTERESIS_GRIP: joint.first[HYSTERESIS_GRIP]}
    for other in fit.band.fits([(structure, start)]):
        likelier = other.cost < fit.cost - CHANCE and _explains_more(other, fit, HYSTERETIC)
        if likelier and HYSTERETIC.is_possible(other.fitted):
            yield other


def _explains_more(other: JointInBand, fit: JointInBand, shape: SoughtShape) -> bool:
    """Whether a fit leaves clearly less of the squared acceleration of a balance with the term."""
    left, sides = other.shares, shape.shown_in & other.shares.keys()
    return any(left[side] ** 2 < LIKELIER * fit.shares[side] ** 2 for side in sides)


def with_shape(shape: SoughtShape, fit: JointInBand, kept: Collection[str]) -> JointInBand:
    """Return the fit with a term that is sought by itself, if likelier.

    Each law of the term is fitted from the constant with the least cost in a quadratic
    approximation about the fit without the term.
    """
    structure = fit.fitted.structure
    if shape.coefficients.isdisjoint(structure.joint.shapes) or shape.is_in(fit.fitted):
        return fit
    best, enough = fit, (1.0 - _LEAST_PROMISED) * fit.fitted.minimum.equations.cost
    for wider in shape.extensions(structure, kept):
        promising = sorted(_promises(shape, fit.fitted, wider))[:FOLLOWED]
        for start in (value for promised, value in promising if promised < enough):
            # With equal sizes the costs compare the terms alone; with its own, the term explains.
            own, begun = shape.put(wider, start), fit.fitted.by_name
            with suppress(ConvergenceError):
                alike = fit.band.fit(own, begun, fit.sizes)
                if alike.cost >= fit.cost - CHANCE:
                    break
                freed = fit.band.fit(own, alike.fitted.by_name)
                if not (shape.is_seen_in(alike.fitted) and shape.is_seen_in(freed.fitted)):
                    continue  # another start may lead to a possible constant
                if _explains_more(freed, fit, shape) and shape.is_plausible(freed.fitted):
                    ended = [each for each in (alike, freed) if each.fitted.converged]
                    best = min([best, *ended], key=cost_of)
                break
    return best


def _promises(shape: SoughtShape, fitted: Fitted, wider: Structure) -> list[tuple[float, float]]:
    """Return the cost to expect with each candidate of a shape's constant, and the candidate."""
    held = wider.with_hold(fitted.problem.timing.hold)  # a thinned log has another one

    def promised(value: float) -> tuple[float, float]:
        minimum = expanded(shape.put(held, value), fitted).minimum
        cost = minimum.equations.cost - minimum.reduced.decrement
        return (cost if np.isfinite(cost) else np.inf), value

    return side_by_side(promised, shape.visible_candidates(fitted))


def _stiffer(values: Mapping[str, float], link: Mapping[str, float]) -> dict[str, float]:
    """Return values with the link's spring by least squares, in both balances."""
    own = {name: link[name] for name in _MOTOR_OF_LINK if name in link}
    if "alpha1" not in values:
        return {**values, **own}
    motor = {alpha: own[theta] for theta, alpha in _MOTOR_OF_LINK.items() if theta in own}
    share = values["alpha1"] / values["theta2"]
    return {**values, **own, **{name: share * value for name, value in motor.items()}}


def with_width_of_gap(fit: JointInBand) -> JointInBand:
    """Return the fit with the width of its play equal to its gap, or the last that converged."""
    trail: list[tuple[float, float]] = []
    with suppress(ConvergenceError):
        for _ in range(_WIDTHS):
            gap = half_gap(fit.fitted)
            if gap <= 0.0 or is_dead_zone(fit.fitted):
                break
            trail.append((width_of(fit.fitted.structure), gap))
            structure = following(fit.fitted, met(trail))
            fit = fit.band.fit(structure, fit.fitted.by_name, fit.sizes)
    return fit
