"""Elimination of terms that a log does not show.

All terms are fitted at once. Then terms that the log does not show are removed one by one, while
the others follow along the quadratic form of the fit. A term stays if chance would hardly give one
as large, with the correlation of the residuals taken into account. A friction with a negative sign
is removed. Amplitude and phase of an eccentric gear are one term: both coefficients stay, or both
are removed.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import fdtrc

from flexid.arrays import FloatArray
from flexid.estimators.normal_equations import least_with, scaled_inverse
from flexid.estimators.prediction_error import ROUGH
from flexid.identification.full_model.fitting import fit_like
from flexid.identification.full_model.model import LINK, Fitted, Structure
from flexid.identification.vocabulary.evidence import TermEvidence
from flexid.identification.vocabulary.thresholds import Thresholds
from flexid.models.flexible_joint import DISSIPATIVE


def latest(
    before: Sequence[TermEvidence], after: Sequence[TermEvidence]
) -> tuple[TermEvidence, ...]:
    """Return the latest evidence on every term."""
    return tuple({e.name: e for e in (*before, *after)}.values())


def one_by_one(
    fitted: Fitted, kept: Collection[str], thresholds: Thresholds
) -> tuple[Fitted, tuple[TermEvidence, ...]]:
    """Remove terms that cost little, each tested by a fit; return the fit and the evidence.

    A quadratic form is misleading along a direction that the log hardly determines. There a fit may
    end where a drive at rest would just break away. Delays, shapes and offsets are tested before
    frictions, since every drive has friction.
    """
    groups, may_go = _groups(fitted, kept)
    shapes, delays = fitted.structure.joint.shapes, fitted.structure.timing.sought
    base = [name.partition("[")[0] for name in fitted.names]
    terms = dict.fromkeys(
        tuple(dict.fromkeys(base[i] for i in group))
        for group, may in zip(groups, may_go, strict=True)
        if may
    )
    gone: list[TermEvidence] = []
    for term in sorted(
        terms, key=lambda t: (t[0] in DISSIPATIVE, t[0] not in delays, t[0] not in shapes)
    ):
        leaner = fit_like(fitted.structure.without(term), fitted, ROUGH)
        if leaner is None:
            continue
        rise = leaner.minimum.equations.cost - fitted.minimum.equations.cost
        if rise <= thresholds.exchange_fall * len(term) * max(1.0, fitted.excess):
            values = ((name, fitted.by_name.get(name, 0.0)) for name in term)
            gone += [TermEvidence(name, False, value, np.inf, 1.0) for name, value in values]
            fitted = leaner
    return fitted, tuple(gone)


def eliminate(
    full: Fitted,
    kept: Collection[str],
    thresholds: Thresholds,
    *,
    likely: Collection[str] = (),
) -> tuple[Structure, tuple[TermEvidence, ...]]:
    """Remove terms one by one, unusual ones first, until chance explains none of the others.

    Terms that are `likely` stay up to `generous_chance`.
    """
    joint = full.structure.joint
    names = full.names
    base = [name.partition("[")[0] for name in names]
    asked = dict.fromkeys(likely, thresholds.generous_chance)
    asked |= dict.fromkeys(joint.shapes, thresholds.shape_chance)
    limits = np.array([asked.get(b, thresholds.term_chance) for b in base])
    frictions = np.array([b in DISSIPATIVE for b in base])
    delays = np.array([b in full.structure.timing.sought for b in base])
    # A delay of the link's encoder looks like its friction, which every drive has.
    unusual = {*joint.shapes, LINK}
    groups, may_go = _groups(full, kept)
    told = _groups(full, ())[1]  # evidence is given on terms that stay, too
    quadratic = _Quadratic.of(full)
    left = np.ones(len(names), dtype=np.bool_)
    tests: dict[str, TermEvidence] = {}
    while True:
        values, covariance = quadratic.at(left)
        deviations = np.sqrt(np.diag(covariance))
        chance = np.array([quadratic.chance(group, values, covariance) for group in groups])
        negative = frictions & (values < 0.0) & (values > -thresholds.friction_sign * deviations)
        ratio = np.where(negative, 1.0, chance) / limits
        # Beyond the margin, a delayed channel has no data.
        ratio[delays & (np.abs(values) > full.data.margin)] = np.inf
        candidates = [i for i in np.flatnonzero(left) if may_go[i] and (ratio[i] > 1.0)]
        free = [i for i in candidates if not np.isfinite(deviations[i])]
        tests |= {
            names[i]: TermEvidence(
                names[i], True, float(values[i]), float(deviations[i]), float(chance[i])
            )
            for i in np.flatnonzero(left)
            if told[i]
        }
        if not candidates:
            break
        gone = max(
            free or candidates,
            key=lambda i: (base[i] in unusual, ratio[i], i),
        )
        left[groups[gone]] = False
        left[[b == joint.nonlinear.get(base[gone]) for b in base]] = False
        tests |= {names[i]: replace(tests[names[i]], kept=False) for i in groups[gone]}
    dropped = [names[i] for i in np.flatnonzero(~left)]
    whole = {b for b, stays in zip(base, left, strict=True) if stays}
    return full.structure.without(n for n in dropped if n.partition("[")[0] not in whole), tuple(
        tests.values()
    )


def _groups(fitted: Fitted, kept: Collection[str]) -> tuple[list[list[int]], list[bool]]:
    """Return, for each name, the places of its term's coefficients and whether they may go."""
    # If logs have their own values, a group has the coefficients of one log.
    joint, delays = fitted.structure.joint, fitted.structure.timing.sought
    term_of = {c: term for term, coefficients in joint.terms.items() for c in coefficients}
    term_of |= {own: own for own in joint.nonlinear.values()}  # these follow their term untested
    named = [(base, log) for base, _, log in (n.partition("[") for n in fitted.names)]
    keys = [(term_of.get(base, base), log) for base, log in named]
    groups = [[i for i, other in enumerate(keys) if other == key] for key in keys]
    stays = {*kept, *joint.nonlinear.values()}
    may_go = [(b in joint.optional or b in delays) and b not in stays for b, _ in named]
    return groups, [all(may_go[j] for j in group) for group in groups]


@dataclass(frozen=True, eq=False)
class _Quadratic:
    """Sum of squares about its minimum, with deviations for correlated residuals."""

    information: FloatArray
    values: FloatArray
    factors: FloatArray
    freedom: FloatArray

    @classmethod
    def of(cls, full: Fitted) -> "_Quadratic":
        factors = full.scatter
        usable = np.isfinite(factors)
        middle = float(np.median(factors[usable])) if usable.any() else 1.0
        freedom = np.array(full.fit.degrees_of_freedom)
        return cls(
            full.information,
            full.values,
            # Few blocks may agree by chance, but sensor noise is always present.
            np.maximum(np.where(usable, factors, middle), 1.0),
            np.where(usable & (freedom > 0.0), freedom, 5.0),
        )

    def chance(self, group: list[int], values: FloatArray, covariance: FloatArray) -> float:
        """Return the chance of values as large if all are zero; one if a value is free."""
        part = covariance[group][:, group]
        if not np.isfinite(part).all():
            return 1.0
        if len(group) == 1:  # a shortcut: most groups have one value, and calls are thousands
            inverse, free = 1.0 / np.where(part > 0.0, part, 1.0), part <= 0.0
        else:
            inverse, free = scaled_inverse(part, np.sqrt(np.diag(part)))
        if free.any():
            return 1.0
        square = float(values[group] @ inverse @ values[group])
        return float(fdtrc(len(group), min(self.freedom[group]), square / len(group)))

    def at(self, left: np.ndarray) -> tuple[FloatArray, FloatArray]:
        """Return values and covariance with some coefficients; zero and infinite for the others."""
        values, covariance = np.zeros(len(left)), np.diag(np.full(len(left), np.inf))
        places = np.flatnonzero(left)
        values[left], inverse, free = least_with(left, self.information, self.values)
        spread = np.sqrt(np.maximum(np.diag(inverse), 0.0)) * self.factors[places]
        free = free | (spread <= 0.0)
        found = inverse * np.outer(self.factors[places], self.factors[places])
        found[free | free[:, None]] = 0.0
        found[free, free] = np.inf
        covariance[np.ix_(places, places)] = found
        return values, covariance
