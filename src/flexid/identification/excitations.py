"""Excitation of the rows of a log: assumption (A4) of Huang (2003), measured."""

from collections.abc import Collection, Iterable, Sequence

import numpy as np

from flexid.analysis.excitation import Excitation, excitation_of_gram
from flexid.arrays import FloatArray
from flexid.estimators.rowwise import RowSums

# By the spring, which acts on both rows, with how it is curved and damped.
_COUPLED = {"theta2", "alpha1", "beta1"} | {
    f"{row}_{law}" for row in ("theta", "alpha") for law in ("cubic", "damping")
}
_SPRINGS = ("theta2", "alpha1")
_OFFSETS = ("theta_offset", "alpha_offset")
_LEAST_MOTION = (
    1e-9  # of a deflection's square, about its mean: 0.3 mrad where zeros are 10 rad apart
)


def row_excitation(row: RowSums, known: Collection[str]) -> Excitation:
    """Excitation of a row beside what is known of it.

    Where a constant is sought beside the spring, the deflection counts from its mean: where the
    encoders have their zeros says nothing about the motion.
    """
    sought = [place for place, name in enumerate(row.coefficients) if name not in known]
    if not sought:
        return Excitation(row.name, (), np.ones(1), 0.0, (), np.empty(0), 0.0, ())
    names = [row.coefficients[place] for place in sought]
    gram = _from_its_mean(names, row.gram[np.ix_(sought, sought)])
    return excitation_of_gram(row.name, names, gram / row.count)


def _from_its_mean(names: Sequence[str], gram: FloatArray) -> FloatArray:
    """Gram matrix with the deflection less its part along the constants that are sought."""
    constants = [i for i, name in enumerate(names) if name.partition("[")[0] in _OFFSETS]
    springs = [i for i, name in enumerate(names) if name in _SPRINGS]
    change = np.eye(len(names))
    constant, along = gram[np.ix_(constants, constants)], gram[np.ix_(constants, springs)]
    change[np.ix_(springs, constants)] = -np.linalg.lstsq(constant, along)[0].T
    centred = change @ gram @ change.T
    # A deflection that does not move leaves noise and rounding, which would pass for a motion.
    moves = np.diag(centred)[springs] > _LEAST_MOTION * np.diag(gram)[springs]
    return centred if moves.all() else gram


def unexcited(rows: Iterable[RowSums], lost_condition: float) -> frozenset[str]:
    """Coefficients with a part in a direction that the motion does not excite.

    Along such a direction a fit may end anywhere, and the quadratic form about where it ended knows
    nothing of that.
    """
    found: set[str] = set()
    for row in rows:
        if not row.coefficients:
            continue
        excitation = row_excitation(row, ())
        if excitation.condition_number > lost_condition:
            found |= {*excitation.confounded}
    return frozenset(found | _COUPLED if found else found)
