"""Control laws, references, and loops whose parts fit together."""

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
    """Assert that with the true gravity the joint comes to rest where it shall, held by gravity."""
    law = pd_gravity(40.0, 8.0, {"gravity_torque": 5.0, "joint_stiffness": 100.0})
    loop = ClosedLoop(JOINT, UNKNOWN, law, constant(target), {"link": 1.0, "motor": 1.0})
    run = simulate(loop, 60.0, 0.1)
    deflection = 5.0 * np.sin(target) / 100.0
    assert run.states[-1] == pytest.approx([target, 0.0, target + deflection, 0.0], abs=1e-6)
    assert run.inputs[-1, 0] == pytest.approx(5.0 * np.sin(target), abs=1e-4)


@pytest.mark.parametrize(
    ("name", "value"), [("k", 10.0), ("largest_link_inertia", 3.0), ("largest_motor_inertia", 0.1)]
)
def test_gains_follow_the_parameters(name: str, value: float) -> None:
    """Assert that a law with another parameter has the gains of a law that was made with it."""
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
    """Assert that NumPy's value of every derivative is that of the text, differentiated."""
    text = to_sympy(reference.expression, {"t", *reference.parameters})
    values = [(symbol(name), value) for name, value in reference.parameters.items()]
    derivative = sp.diff(text, symbol("t"), order).subs(values)
    expected = sp.lambdify(symbol("t"), derivative)(TIMES)
    scale = 1.0 + np.max(np.abs(expected))
    assert np.max(np.abs(reference.evaluate(TIMES, order) - expected)) < 1e-13 * scale


ARM = ParametricSystem("arm", (Row("arm", "q", "v", {"gravity": "-sin(q)"}, known="u"),))


def declared(law: str, tracked: str = "q", name: str = "u", taken: str = "gain") -> LoopDeclaration:
    """A loop of an arm with a law."""
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
    """Assert that a law with a wrong value, expression or name is refused by what is wrong."""
    refusals(REFUSED)


def test_values_do_not_change_the_digest() -> None:
    """Assert that a law with other values is the same derivation, another expression is not."""
    law = robust_law()
    assert robust_law(k=10.0).digest == law.digest
    assert Controller("law", "q", {"u": "-v"}).digest != Controller("law", "q", {"u": "-q"}).digest
