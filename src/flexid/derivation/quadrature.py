"""The fixed rule by which generated code integrates a regressor over a velocity.

Friction changes within a fraction of a rad/s while velocities reach a hundred, so plain
Gauss-Legendre nodes on [0, v] would step over all that happens near zero. The rule is composite:
panels that halve towards zero, with the same number of Gauss-Legendre nodes each. As the panels
scale with v, the whole rule is one table of nodes on [0, 1].
"""

from functools import cache

import numpy as np
from numpy.typing import NDArray

PANELS = 10
"""Panels of the generated code; the first ends at v / 2⁹."""

NODES_PER_PANEL = 8


@cache
def graded_rule(
    panels: int = PANELS, nodes_per_panel: int = NODES_PER_PANEL
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Nodes and weights on [0, 1], dense towards 0: ∫₀^v r dξ ≈ v Σ weights r(v nodes)."""
    ends = np.concatenate([[0.0], 2.0 ** np.arange(1 - panels, 1)])
    nodes, weights = np.polynomial.legendre.leggauss(nodes_per_panel)
    starts, widths = ends[:-1, None], np.diff(ends)[:, None]
    return (
        (starts + widths * (nodes + 1.0) / 2.0).ravel(),
        (widths * weights / 2.0).ravel(),
    )
