"""Excitation of the rows of a log: a measure of assumption (A4) of Huang (2003)."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from flexid.arrays import FloatArray
from flexid.estimators.excitation import Excitation, excitation_of_gram
from flexid.estimators.normal_equations import eigen
from flexid.estimators.state_variable_filter import RowFit
from flexid.identification.full_model.starting import DIRECTED
from flexid.models import flexible_joint as declared

# The spring with its curvature and damping, which couples both rows.
_COUPLED = declared.POSITIVE | declared.HARDENING | declared.DAMPING
_NEARLY_CONSTANT = (
    *declared.SPRING,
    *declared.coefficients_of("gravity_cosine"),
)  # regressors that are counted from their mean next to an offset
_OFFSETS = (
    *declared.TERMS["link_offset"].coefficients,
    *declared.TERMS["motor_offset"].coefficients,
)
# Least share of equations during which a side keeps moving: 0.72 in a step response, 0.002 if the
# side reverses too fast for the filter.
_MOSTLY = 0.5
_SCATTER = 3.0  # standard deviations that a mean square of noise may exceed its expectation by
_NO_MOTION = 1e-100  # least sum of squared accelerations, for a clamped row
_PART = 0.1  # least squared component of a coefficient that is part of a direction
# Least share of a square that is left about the mean: 10 µrad for zeros 10 rad apart. Rounding
# leaves 1e-15. With 1e-9, antennas that bend by 50 µrad were undetermined for zeros 1.2 rad apart.
_LEAST_MOTION = 1e-12


def row_excitation(row: RowFit) -> Excitation:
    """Return the excitation of a row's coefficients.

    If an offset is sought next to the spring, the deflection counts from its mean, since the
    encoders' zeros are no motion. The same holds for the cosine of a tilted gravity, which hardly
    changes about its rest.
    """
    centred = _centred_gram(row.coefficients, row.gram)
    # Without motion the remainder is only rounding.
    used = centred.gram if centred.moves else row.gram
    return excitation_of_gram(row.name, row.coefficients, used / row.count)


class _Centred(NamedTuple):
    """Gram matrix of a row, with deflection and cosine centred if an offset is sought."""

    gram: FloatArray  # (k, k)
    change: FloatArray  # (k, k): matrix that maps the row's regressors to the centred ones
    moves: bool  # whether the centred regressors show motion, not only noise and rounding


def _centred_gram(names: Sequence[str], gram: FloatArray) -> _Centred:
    constants = [i for i, name in enumerate(names) if name.partition("[")[0] in _OFFSETS]
    nearly_constant = [i for i, name in enumerate(names) if name in _NEARLY_CONSTANT]
    change = np.eye(len(names))
    constant, along = gram[np.ix_(constants, constants)], gram[np.ix_(constants, nearly_constant)]
    change[np.ix_(nearly_constant, constants)] = -np.linalg.lstsq(constant, along)[0].T
    centred = change @ gram @ change.T
    moves = np.diag(centred)[nearly_constant] > _LEAST_MOTION * np.diag(gram)[nearly_constant]
    return _Centred(centred, change, bool(moves.all()))


def unexcited(
    rows: Iterable[RowFit], values: Mapping[str, float], lost_share: float
) -> frozenset[str]:
    """Return the coefficients that are part of a direction which the motion does not excite.

    Along such a direction a fit may end anywhere, and its covariance does not show that.
    """
    found: set[str] = set()
    for row in rows:
        if row.coefficients:
            shares, part_of = directions(row, values)
            for share, parts in zip(shares.tolist(), part_of, strict=True):
                found |= parts if share < lost_share else frozenset()
    return frozenset(found | _COUPLED if found & _COUPLED else found)


def one_way_frictions(
    rows: Iterable[RowFit], kept: Collection[str], lost_share: float
) -> dict[str, dict[str, float]]:
    """Return removed dry frictions that the log cannot show, and their kept equivalents.

    While a side turns one way under a constant torque, its friction is constant too. More friction
    then looks like less torque and inertia. At rest before the motion, friction balances the torque
    and does not show either. The equivalents are factors of kept coefficients, by name.
    """
    hidden: dict[str, dict[str, float]] = {}
    for row in rows:
        kept_places = [i for i, name in enumerate(row.coefficients) if name in kept]
        for place, name in enumerate(row.coefficients):
            if name not in declared.DRY_FRICTIONS or name in kept:
                continue
            moving = np.abs(row.regressors[place]) >= DIRECTED
            ways, others = row.regressors[place, moving], row.regressors[kept_places][:, moving]
            if np.mean(moving) < _MOSTLY or len({*np.sign(ways).tolist()}) > 1:
                continue
            parts = np.linalg.lstsq(others.T, ways)[0]
            if np.linalg.norm(ways - parts @ others) < lost_share * np.linalg.norm(ways):
                names = [row.coefficients[i] for i in kept_places]
                hidden[name] = dict(zip(names, parts.tolist(), strict=True))
    return hidden


def without_noise(row: RowFit, noisier: RowFit, independent: float) -> RowFit:
    """Return the row with the noise's part of its Gram matrix removed.

    `noisier` is the row with as much noise added again. With `independent` values the relative
    variance of either square is 2 over their number, and that of twice their product is 4 over it.
    """
    part = 1.0 + _SCATTER * np.sqrt(8.0 / independent)
    return replace(row, gram=row.gram - part * (noisier.gram - row.gram))


def directions(row: RowFit, values: Mapping[str, float]) -> tuple[FloatArray, list[frozenset[str]]]:
    """Return the share of a row's acceleration due to each combination of coefficients.

    Each coefficient counts by its own size, or by the size that alone makes the acceleration, if
    that is larger. On a light motor the torques nearly cancel, and their difference is the motion.

    Returns root mean squares over the acceleration's, shape (k,), the least first, and the
    coefficients in each combination. A row of one coefficient has none.
    """
    names = row.coefficients
    centred = _centred_gram(names, row.gram)
    gram = centred.gram if centred.moves else row.gram
    total = max(row.total_sum, _NO_MOTION)
    own = np.linalg.solve(centred.change.T, np.array([values.get(name, 0.0) for name in names]))
    reach = np.maximum(np.abs(own) * np.sqrt(np.diag(centred.gram).clip(0.0) / total), 1.0)
    norm = np.sqrt(np.diag(gram).clip(0.0))
    scale = reach / np.where(norm > 0.0, norm, 1.0)  # a regressor of zero gives a share of zero
    squares, vectors = eigen(gram * np.outer(scale, scale))
    has_part = (vectors.T**2 >= _PART) & (len(names) > 1)
    parts = [frozenset(np.array(names)[own].tolist()) for own in has_part]
    return np.sqrt(np.maximum(squares, 0.0)), parts


def row_sizes(rows: Sequence[RowFit]) -> dict[str, float]:
    """Return each regressor's root mean square over its row's acceleration's, by coefficient."""
    sizes = {}
    for row in rows:
        total = max(row.total_sum, _NO_MOTION)
        for name, square in zip(row.coefficients, np.diag(row.gram).tolist(), strict=True):
            sizes[name] = (square / total) ** 0.5
    return sizes
