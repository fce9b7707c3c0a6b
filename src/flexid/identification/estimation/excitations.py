"""Excitation of the rows of a log: assumption (A4) of Huang (2003), measured."""

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

# By the spring, which acts on both rows, with how it is curved and damped.
_COUPLED = declared.POSITIVE | declared.HARDENING | declared.DAMPING
_STANDING = (
    *declared.SPRING,
    *declared.coefficients_of("gravity_cosine"),
)  # which a constant takes part of
_OFFSETS = (
    *declared.TERMS["link_offset"].coefficients,
    *declared.TERMS["motor_offset"].coefficients,
)
# Of equations, those in which a side that turns one way keeps moving: 0.72 in a step response,
# 0.002 where it turns round so fast that the filter hardly ever forgets it.
_MOSTLY = 0.5
_SCATTER = 3.0  # standard deviations of a mean square, by which noise may exceed its own
_NO_MOTION = 1e-100  # squares of an acceleration, summed: a row that is clamped has none
_PART = 0.1  # of a direction, from which on a coefficient counts as part of it
_LEAST_MOTION = (
    1e-9  # of a deflection's square, about its mean: 0.3 mrad where zeros are 10 rad apart
)


def row_excitation(row: RowFit, known: Collection[str]) -> Excitation:
    """Excitation of a row beside what is known of it.

    Where a constant is sought besides the spring, the deflection counts from its mean: where the
    encoders have their zeros says nothing about the motion. So does the cosine of a tilted gravity,
    which hardly changes about its rest.
    """
    sought = [place for place, name in enumerate(row.coefficients) if name not in known]
    if not sought:
        return Excitation(row.name, (), np.ones(1), 0.0, (), np.empty(0), 0.0, ())
    names = [row.coefficients[place] for place in sought]
    gram = row.gram[np.ix_(sought, sought)]
    centred = _from_its_mean(names, gram)
    used = centred.gram if centred.moves else gram  # what is left of no motion would pass for one
    return excitation_of_gram(row.name, names, used / row.count)


class _Centred(NamedTuple):
    """A Gram matrix with deflection and cosine less their part along the constants sought."""

    gram: FloatArray  # (k, k)
    change: FloatArray  # (k, k): factors that make its regressors of the row's
    moves: bool  # whether what is left of them is a motion, or noise and rounding


def _from_its_mean(names: Sequence[str], gram: FloatArray) -> _Centred:
    constants = [i for i, name in enumerate(names) if name.partition("[")[0] in _OFFSETS]
    standing = [i for i, name in enumerate(names) if name in _STANDING]
    change = np.eye(len(names))
    constant, along = gram[np.ix_(constants, constants)], gram[np.ix_(constants, standing)]
    change[np.ix_(standing, constants)] = -np.linalg.lstsq(constant, along)[0].T
    centred = change @ gram @ change.T
    moves = np.diag(centred)[standing] > _LEAST_MOTION * np.diag(gram)[standing]
    return _Centred(centred, change, bool(moves.all()))


def unexcited(
    rows: Iterable[RowFit], values: Mapping[str, float], lost_share: float
) -> frozenset[str]:
    """Coefficients with a part in a direction that the motion does not excite.

    Along such a direction a fit may end anywhere, and the quadratic form about where it ended knows
    nothing of that.
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
    """Dry frictions beside what was kept that the rows cannot show, and what each passes for.

    A side that keeps turning one way under a constant torque has a constant friction: that torque
    less a part of it moves the same drive, a lighter one. Before it moves friction balances what
    acts, and nothing of that is seen either.
    """
    hidden: dict[str, dict[str, float]] = {}
    for row in rows:
        beside = [i for i, name in enumerate(row.coefficients) if name in kept]
        for place, name in enumerate(row.coefficients):
            if name not in declared.DRY_FRICTIONS or name in kept:
                continue
            moving = np.abs(row.regressors[place]) >= DIRECTED
            ways, others = row.regressors[place, moving], row.regressors[beside][:, moving]
            if np.mean(moving) < _MOSTLY or len({*np.sign(ways).tolist()}) > 1:
                continue
            parts = np.linalg.lstsq(others.T, ways)[0]
            if np.linalg.norm(ways - parts @ others) < lost_share * np.linalg.norm(ways):
                names = [row.coefficients[i] for i in beside]
                hidden[name] = dict(zip(names, parts.tolist(), strict=True))
    return hidden


def without_noise(row: RowFit, noisier: RowFit, independent: float) -> RowFit:
    """A row whose Gram matrix is that of the motion alone, from so many independent values.

    Noise that is added shows what the sensors' own makes of it. Either square scatters by 2 over
    their number, and twice their product by 4, relative variances.
    """
    part = 1.0 + _SCATTER * np.sqrt(8.0 / independent)
    return replace(row, gram=row.gram - part * (noisier.gram - row.gram))


def directions(row: RowFit, values: Mapping[str, float]) -> tuple[FloatArray, list[frozenset[str]]]:
    """How much of a row's acceleration combinations of its coefficients make, the least first.

    Each coefficient counts by its own size, or by what moves the row as much as it does move, if
    that is more: the torques on a light motor all but cancel, and what they leave is its motion.

    Returns their root mean squares, shape (k,), over that of the acceleration, and what has a part
    in each: nothing in a row of one coefficient.
    """
    names = row.coefficients
    centred = _from_its_mean(names, row.gram)
    gram = centred.gram if centred.moves else row.gram
    total = max(row.total_sum, _NO_MOTION)
    own = np.linalg.solve(centred.change.T, np.array([values.get(name, 0.0) for name in names]))
    reach = np.maximum(np.abs(own) * np.sqrt(np.diag(centred.gram).clip(0.0) / total), 1.0)
    norm = np.sqrt(np.diag(gram).clip(0.0))
    scale = reach / np.where(norm > 0.0, norm, 1.0)  # what does not move at all is lost
    squares, vectors = eigen(gram * np.outer(scale, scale))
    has_part = (vectors.T**2 >= _PART) & (len(names) > 1)
    parts = [frozenset(np.array(names)[own].tolist()) for own in has_part]
    return np.sqrt(np.maximum(squares, 0.0)), parts


def row_sizes(rows: Sequence[RowFit]) -> dict[str, float]:
    """Root mean square of each coefficient's regressor over that of its row's acceleration."""
    sizes = {}
    for row in rows:
        total = max(row.total_sum, _NO_MOTION)
        for name, square in zip(row.coefficients, np.diag(row.gram).tolist(), strict=True):
            sizes[name] = (square / total) ** 0.5
    return sizes
