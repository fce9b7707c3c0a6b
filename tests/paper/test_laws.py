"""Control laws, among them eq. (11), references, and loops of compatible parts."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import sympy as sp

from flexid.derivation.symbolic import symbol, to_sympy
from flexid.models.flexible_joint import flexible_joint
from flexid.models.parametric_system import ParametricSystem, Row
from flexid.paper.laws import Controller, pd_gravity, robust_law
from flexid.paper.loop import LoopDeclaration, Multisine, constant, sinusoid
from flexid.simulation.closed_loop import ClosedLoop, simulate

TRUE = {"theta1": 5.0, "theta2": 100.0, "alpha1": 1000 / 3, "alpha2": 1 / 3, "beta1": 10 / 3}
JOINT = flexible_joint(known={"beta1": TRUE["beta1"]})
UNKNOWN = {name: TRUE[name] for name in JOINT.coefficients}


@pytest.mark.parametrize("target", [-2.5, 1.0, 3.0])
def test_settles_at_the_reference(target: float) -> None:
    """Assert that with the true gravity the joint settles at the reference, gravity balanced."""
    law = pd_gravity(40.0, 8.0, {"gravity_torque": 5.0, "joint_stiffness": 100.0})
    held = sinusoid(0.0, 5.0, offset=target)  # other tests compile this loop too
    loop = ClosedLoop(JOINT, UNKNOWN, law, held, {"link": 1.0, "motor": 1.0})
    run = simulate(loop, 60.0, 0.1)
    deflection = 5.0 * np.sin(target) / 100.0
    assert run.states[-1] == pytest.approx([target, 0.0, target + deflection, 0.0], abs=1e-6)
    assert run.inputs[-1, 0] == pytest.approx(5.0 * np.sin(target), abs=1e-4)


@pytest.mark.parametrize(
    ("name", "value"), [("k", 10.0), ("largest_link_inertia", 3.0), ("largest_motor_inertia", 0.1)]
)
def test_gains_follow_the_parameters(name: str, value: float) -> None:
    """Assert that a changed parameter gives the gains of a law created with it."""
    law = robust_law()
    made: dict[str, Any] = {name: value}
    changed = replace(law, parameters={**law.parameters, **made})
    assert changed.values == robust_law(**made).values
    assert changed.values != law.values


TIMES = np.linspace(0.0, 2.0, 41)
TWO_TONES = Multisine([3.0, 0.5], [5.0, 13.2], [0.3, -1.1], 0.7)


@pytest.mark.parametrize("reference", [sinusoid(3.0, 5.0), TWO_TONES, constant(1.2)])
@pytest.mark.parametrize("order", range(6))
def test_evaluation_is_derivative_of_text(reference: Multisine, order: int) -> None:
    """Assert that NumPy's value of every derivative equals the differentiated text's."""
    text = to_sympy(reference.expression, {"t", *reference.parameters})
    values = [(symbol(name), value) for name, value in reference.parameters.items()]
    derivative = sp.diff(text, symbol("t"), order).subs(values)
    expected = sp.lambdify(symbol("t"), derivative)(TIMES)
    scale = 1.0 + np.max(np.abs(expected))
    assert np.max(np.abs(reference.evaluate(TIMES, order) - expected)) < 1e-13 * scale


ARM = ParametricSystem("arm", (Row("arm", "q", "v", {"gravity": "-sin(q)"}, known="u"),))


def declared(law: str, tracked: str = "q", name: str = "u", taken: str = "gain") -> LoopDeclaration:
    """Return the declaration of an arm's loop with a law."""
    controller = Controller("law", tracked, {name: law}, {taken: 1.0})
    return LoopDeclaration(ARM, controller, constant(1.0))


CLASHES = ("q", "gravity", "qd_2", "t", "sin", "qd_offset", "lambda")
REFUSED: dict[str, Callable[[], object]] = {
    "a gain that overflows": lambda: robust_law(k=1e200).values,
    "uneven lists": lambda: Multisine([1.0, 2.0], [3.0]),
    "not in the whitelist": lambda: declared("__import__('os')"),
    "an undeclared name": lambda: declared("stiffness*(qd - q)"),
    "another input": lambda: declared("-v", name="torque"),
    "another state": lambda: declared("-v", "x1"),
    **{name: lambda name=name: declared("-v", taken=name) for name in CLASHES},
}


def test_laws_that_do_not_fit(refusals: Any) -> None:
    """Assert that a law with a wrong value, expression or name is refused with the reason."""
    refusals(REFUSED)


def test_values_do_not_change_the_digest() -> None:
    """Assert that the digest ignores values of a law, and depends on its expressions."""
    law = robust_law()
    assert robust_law(k=10.0).digest == law.digest
    assert Controller("law", "q", {"u": "-v"}).digest != Controller("law", "q", {"u": "-q"}).digest


def test_feedforward_moves_the_nominal_joint_along_the_reference() -> None:
    """Assert u_N = Jr w2N' + mu w2N + ke (w1N - qd), solving eq. (4), Jr before the bracket."""
    time = sp.Symbol("t")
    gravity, link, motor, friction, stiffness = sp.symbols("mgl Jl Jr mu ke", positive=True)
    q = sp.Function("q")(time)
    q_1, q_2, q_3, q_4 = (q.diff(time, order) for order in range(1, 5))

    w1 = q + (gravity * sp.sin(q) + link * q_2) / stiffness
    w2 = q_1 + (gravity * sp.cos(q) * q_1 + link * q_3) / stiffness
    bracket = gravity * q_2 * sp.cos(q) - gravity * q_1**2 * sp.sin(q) + link * q_4
    rest = friction * w2 + gravity * sp.sin(q) + link * q_2

    assert sp.expand(w1.diff(time) - w2) == 0
    torque = motor * w2.diff(time) + friction * w2 + stiffness * (w1 - q)
    assert sp.expand(torque - (motor * q_2 + motor / stiffness * bracket + rest)) == 0
    assert sp.expand(torque - (motor * q_2 + bracket / stiffness + rest)) != 0
    link_row = link * q_2 + gravity * sp.sin(q) + stiffness * (q - w1)
    motor_row = motor * w1.diff(time, 2) - stiffness * (q - w1) + friction * w1.diff(time) - torque
    assert sp.expand(link_row) == sp.expand(motor_row) == 0


def test_link_angle_has_relative_degree_four() -> None:
    """Assert that the torque first appears in the fourth derivative of x1: no zero dynamics."""
    x1, x2, x3, x4, u = states = sp.symbols("x1 x2 x3 x4 u")
    t1, t2, a1, a2, b1 = sp.symbols("theta1 theta2 alpha1 alpha2 beta1", positive=True)
    rates = sp.Matrix(
        [x2, -t1 * sp.sin(x1) - t2 * (x1 - x3), x4, a1 * (x1 - x3) - a2 * x4 + b1 * u]
    )
    output: sp.Expr = x1
    gains = []
    for _ in range(4):
        output = (sp.Matrix([output]).jacobian(states[:4]) * rates)[0]
        gains.append(sp.expand(output).coeff(u))
    assert gains == [0, 0, 0, t2 * b1]
