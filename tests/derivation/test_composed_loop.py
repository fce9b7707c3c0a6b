"""Closed loops composed symbolically."""

from typing import cast

import numpy as np
import pytest
import sympy as sp
from systems import THREE_ROWS

from flexid.derivation.symbolic import symbol
from flexid.errors import AccelerationError, ModelError
from flexid.models.expression import evaluate
from flexid.models.flexible_joint import flexible_joint
from flexid.paper.closed_loop import compose_loop
from flexid.paper.laws import REFERENCE_NAMES, Controller, pd_gravity, robust_law
from flexid.paper.loop import LoopDeclaration, Multisine, sinusoid
from flexid.paper.observer import derive_observer
from flexid.simulation.closed_loop import loop_kernel

JOINT = flexible_joint(known={"beta1": 10 / 3})
PAPER = LoopDeclaration(JOINT, robust_law(), sinusoid(3.0, 5.0))

CURVED = Controller(
    "law in curved coordinates",
    "q2",
    {"u1": "-stiffness*(q1 - aim) - slip", "u2": "-v3 + qd_2"},
    {"stiffness": 4.0},
    {"aim": "qd + qd_1**2/5", "slip": "v1 - qd_1 + sin(q1)"},
    {
        "s1": "q1 - aim",
        "s2": "slip",
        "s3": "q2 + q1**2/3",
        "s4": "v2 - stiffness*q1*v1",
        "s5": "q3 - qd_1",
        "s6": "v3 + sin(q2 + q3)",
    },
)
CURVED_LOOP = LoopDeclaration(THREE_ROWS, CURVED, Multisine([0.5, 0.3], [2.0, 3.1], [0.2, 0.4]))

UNKNOWN_GAIN = LoopDeclaration(flexible_joint(), pd_gravity(), Multisine([1.2, 0.6], [2.0, 5.3]))

loops = pytest.mark.parametrize(
    "declaration", [PAPER, CURVED_LOOP, UNKNOWN_GAIN], ids=["paper", "curved", "unknown gain"]
)


def parameters(declaration: LoopDeclaration) -> np.ndarray:
    """Return values for all parameters: declared ones, and arbitrary ones for the rest."""
    system, law, reference = declaration.system, declaration.controller, declaration.reference
    given = {**system.constants, **law.values, **reference.parameters}
    names = declaration.parameter_names
    return np.array([given.get(name, 1.0 + place / 7) for place, name in enumerate(names)])


@loops
def test_derivatives(declaration: LoopDeclaration) -> None:
    """Assert that Jacobian and time derivative match central differences of the rates."""
    kernel, p = loop_kernel(declaration), parameters(declaration)
    z = np.random.default_rng(2).normal(size=kernel.SIZE)
    dz, slope = np.empty(kernel.SIZE), np.empty(kernel.SIZE)
    jacobian = np.zeros((kernel.SIZE, kernel.SIZE))
    kernel.rates_and_jacobian(0.3, z, p, dz, jacobian, slope)

    def rates(t: float, z: np.ndarray) -> np.ndarray:
        result = np.empty(kernel.SIZE)
        kernel.rates(t, z, p, result)
        return result

    h = 1e-5
    columns = [(rates(0.3, z + h * e) - rates(0.3, z - h * e)) / (2 * h) for e in np.eye(len(z))]
    scale = np.max(np.abs(jacobian), axis=1, keepdims=True)
    assert np.max(np.abs(np.array(columns).T - jacobian) / scale) < 1e-6
    difference = (rates(0.3 + h, z) - rates(0.3 - h, z)) / (2 * h)
    assert difference == pytest.approx(slope, rel=1e-5, abs=1e-6 * np.max(np.abs(slope)))
    assert rates(0.3, z) == pytest.approx(dz, rel=1e-12)


@loops
def test_both_routes_agree(declaration: LoopDeclaration) -> None:
    """Assert that eq. (7) in coordinates gives the motion of eqs. (1) to (3) in plain states."""
    kernel, p = loop_kernel(declaration), parameters(declaration)
    x = 0.5 * np.random.default_rng(3).normal(size=kernel.N_STATES)
    estimates = np.random.default_rng(4).normal(size=kernel.N_COEFFICIENTS)
    z, dz = np.empty(kernel.SIZE), np.empty(kernel.SIZE)
    kernel.start(0.3, x, estimates, p, z)
    kernel.rates(0.3, z, p, dz)

    def states_and_estimates(h: float) -> np.ndarray:
        y = np.empty(kernel.N_OUTPUTS)
        kernel.outputs(0.3 + h, z + h * dz, p, y)
        first = kernel.N_STATES + kernel.N_INPUTS
        return np.concatenate((y[: kernel.N_STATES], y[first : first + kernel.N_COEFFICIENTS]))

    moved = (states_and_estimates(1e-6) - states_and_estimates(-1e-6)) / 2e-6
    expected = plain_rates(declaration, 0.3, x, estimates)
    assert moved == pytest.approx(expected, rel=1e-5, abs=1e-7 * max(abs(expected)))


def plain_rates(
    declaration: LoopDeclaration, t: float, x: np.ndarray, estimates: np.ndarray
) -> np.ndarray:
    """Return x' and the rates of the estimates, from eqs. (1) to (3) as printed."""
    system, law = declaration.system, declaration.controller
    values = dict(zip(declaration.parameter_names, parameters(declaration), strict=True))
    values |= dict(zip(system.states, x, strict=True))
    values |= {
        name: float(declaration.reference.evaluate(t, order))
        for order, name in enumerate(REFERENCE_NAMES)
    }
    for name, text in {**law.definitions, **law.inputs}.items():
        values[name] = evaluate(text, values, name)
    observer = derive_observer(system)
    numbers = {symbol(name): value for name, value in values.items()}
    numbers |= {row.gain: values[f"_gain{place}"] for place, row in enumerate(observer.rows)}
    numbers |= zip((p for row in observer.rows for p in row.estimates), estimates, strict=True)
    numbers |= dict.fromkeys(observer.rates, 0.7)  # u' cancels, so any value will do
    rates = observer.symbolic.right_hand_side
    moving = [*observer.symbolic.states, *observer.symbolic.inputs]
    speeds = [*rates, *observer.rates]
    moved = [
        update + sum(sp.diff(p, x) * rate for x, rate in zip(moving, speeds, strict=True))
        for row in observer.rows
        for p, update in zip(row.outputs, row.updates, strict=True)
    ]
    return np.array([float(cast(sp.Expr, one.xreplace(numbers))) for one in (*rates, *moved)])


@pytest.mark.parametrize("second", ["x2 + x4", "2*x2", "x2 + x2**2"])
def test_map_must_be_triangular(second: str) -> None:
    """Assert that a coordinate must be its state plus a function of earlier states."""
    law = Controller("law", "x1", {"u": "-x4"}, coordinates={
        "s1": "x1", "s2": second, "s3": "x3", "s4": "x4"
    })  # fmt: skip
    with pytest.raises(ModelError, match="s2 must be x2 plus"):
        compose_loop(LoopDeclaration(JOINT, law, sinusoid(1.0, 1.0)))


def test_what_a_loop_leaves_out() -> None:
    """Assert e1' = e2 - k e1, no nominal term in e3', and no observer that needs accelerations."""
    loop = compose_loop(PAPER)
    e1, e2, e3, e4 = loop.variables[:4]
    k, gain1, gain2 = symbol("k"), symbol("gain1"), symbol("gain2")
    assert sp.expand(loop.rates[0] - (e2 - k * e1)) == 0
    assert sp.expand(loop.rates[2] - (e4 - gain2 * e3 + gain1 * loop.rates[1])) == 0
    assert loop.tracking_error == e1
    damped = flexible_joint(("gravity", "joint_damping"), known={"beta1": 10 / 3})
    with pytest.raises(AccelerationError, match="theta_damping"):
        compose_loop(LoopDeclaration(damped, robust_law(), sinusoid(3.0, 5.0)))
