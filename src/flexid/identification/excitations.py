"""Excitation of the rows of a log: assumption (A4) of Huang (2003), measured."""

from collections.abc import Collection

import numpy as np

from flexid.analysis.excitation import Excitation, excitation_of_gram
from flexid.estimators.rowwise import RowSums


def row_excitation(row: RowSums, known: Collection[str]) -> Excitation:
    """Excitation of a row beside what is known of it."""
    sought = [place for place, name in enumerate(row.coefficients) if name not in known]
    if not sought:
        return Excitation(row.name, (), np.ones(1), 0.0, (), np.empty(0), 0.0, ())
    names = [row.coefficients[place] for place in sought]
    return excitation_of_gram(row.name, names, row.gram[np.ix_(sought, sought)] / row.count)
