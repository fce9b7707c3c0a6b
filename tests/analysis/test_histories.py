"""Regressors along a motion, by folding text over arrays."""

import numpy as np
import pytest

from flexid.analysis.histories import RowHistory, regressors_along
from flexid.models.flexible_joint import flexible_joint
from flexid.models.parametric_system import ParametricSystem, Row


def test_regressors_of_the_joint_are_those_of_the_paper():
    """Assert that f = (-sin x1, -(x1 - x3)) and φ = (x1 - x3, -x4) along random states."""
    x = np.random.default_rng(1).normal(size=(50, 4))
    found = regressors_along(flexible_joint(known={"beta1": 1 / 0.3}), x, np.zeros((50, 1)))
    f = np.column_stack([-np.sin(x[:, 0]), -(x[:, 0] - x[:, 2])])
    phi = np.column_stack([x[:, 0] - x[:, 2], -x[:, 3]])
    np.testing.assert_allclose(found["link"], f, rtol=0, atol=1e-15)
    np.testing.assert_allclose(found["motor"], phi, rtol=0, atol=1e-15)


Q, V, U = np.random.default_rng(2).uniform(-1, 1, (3, 20))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("tanh(v/scale) + u**2", np.tanh(V / 0.5) + U**2),
        ("-abs(v)*exp(-q) + pi", -np.abs(V) * np.exp(-Q) + np.pi),
        ("sign(q)*sqrt(abs(u))", np.sign(Q) * np.sqrt(np.abs(U))),
        ("tan(q)/cos(q) - 1", np.tan(Q) / np.cos(Q) - 1),
        ("1", np.ones(20)),
    ],
)
def test_every_part_of_an_expression_has_its_meaning(text, expected):
    """Assert that numbers, constants, inputs, operators and functions mean what NumPy means."""
    system = ParametricSystem("s", (Row("r", "q", "v", {"p": text}),), ("u",), {"scale": 0.5})
    found = regressors_along(system, np.column_stack([Q, V]), U[:, None])["r"][:, 0]
    np.testing.assert_allclose(found, expected, rtol=1e-14)


def test_error_rates_are_those_of_7():
    """Assert that the rates of a row are -c r rᵀp̃, sample by sample."""
    rng = np.random.default_rng(4)
    r, e = rng.normal(size=(2, 10, 3))
    history = RowHistory("row", ("a", "b", "c"), 2.5, r, e)
    expected = [-2.5 * np.outer(ri, ri) @ ei for ri, ei in zip(r, e, strict=True)]
    np.testing.assert_allclose(history.error_rates, expected, rtol=1e-12)
