"""Excitation of the rows of a log: assumption (A4) of Huang (2003), measured."""

from collections.abc import Collection, Iterable

import numpy as np

from flexid.analysis.excitation import Excitation, excitation_of_gram
from flexid.estimators.rowwise import RowSums

# By the spring, which acts on both rows, with how it is curved and damped.
_COUPLED = {"theta2", "alpha1", "beta1"} | {
    f"{row}_{law}" for row in ("theta", "alpha") for law in ("cubic", "damping")
}


def row_excitation(row: RowSums, known: Collection[str]) -> Excitation:
    """Excitation of a row beside what is known of it."""
    sought = [place for place, name in enumerate(row.coefficients) if name not in known]
    if not sought:
        return Excitation(row.name, (), np.ones(1), 0.0, (), np.empty(0), 0.0, ())
    names = [row.coefficients[place] for place in sought]
    return excitation_of_gram(row.name, names, row.gram[np.ix_(sought, sought)] / row.count)


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
