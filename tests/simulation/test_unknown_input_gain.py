"""The exact observer in a closed loop whose input gain is unknown too."""

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp

from flexid.control.pd_gravity import pd_gravity
from flexid.control.references import Multisine
from flexid.derivation.observer import derive_observer
from flexid.derivation.symbolic import symbol, to_sympy
from flexid.models.flexible_joint import flexible_joint
from flexid.simulation.closed_loop import simulate
from flexid.simulation.loop import ClosedLoop

JOINT = flexible_joint()
TRUTH = {"theta1": 5.0, "theta2": 100.0, "alpha1": 1000 / 3, "alpha2": 1 / 3, "beta1": 10 / 3}
START = {name: 0.5 * value for name, value in TRUTH.items()}
GAINS = {"link": 20.0, "motor": 50.0}
AMPLITUDES, FREQUENCIES, PHASES = [1.2, 0.6, 0.3], [2.0, 5.3, 20.0], [0.0, 0.4, 1.0]
LAW = pd_gravity(proportional=20.0, derivative=1.0)
LOOP = ClosedLoop(
    JOINT, TRUTH, LAW, Multisine(AMPLITUDES, FREQUENCIES, PHASES), GAINS, initial_estimates=START
)


def test_converges():
    """Assert that all five estimates come within 1 % of the truth, beta1 among them."""
    run = simulate(LOOP, 600.0, sample_time=0.1)
    errors = np.abs(run.parameter_errors[-1]) / list(TRUTH.values())
    assert errors.max() < 0.01


def test_the_printed_form_with_the_rate_of_the_input_is_the_same():
    """Assert that eqs. (2)-(3) with u' from the controller give the loop's estimates."""
    duration = 1.0
    run = simulate(LOOP, duration, relative_tolerance=1e-9)
    observer = derive_observer(JOINT)
    now, x = symbol("now"), list(observer.symbolic.states)
    u, rate = observer.symbolic.inputs[0], observer.input_rates[0]
    law = _law(now)
    right_hand_side = dict(zip(x, observer.symbolic.right_hand_side, strict=True))
    law_rate = sp.diff(law, now) + sum(sp.diff(law, s) * right_hand_side[s] for s in x)
    estimates, starts, updates = [], [], []
    for row in observer.rows:
        estimates += list(row.outputs)
        updates += list(row.updates)
        starts += list(row.intermediate)
    truth = {symbol(name): value for name, value in TRUTH.items()}
    names = dict(zip([p for row in observer.rows for p in row.estimates], estimates, strict=True))
    gains = dict(zip(observer.gains, GAINS.values(), strict=True))

    def composed(expression: sp.Expr) -> sp.Expr:
        found = expression.xreplace(names).xreplace(gains).xreplace({rate: law_rate})
        return found.xreplace({u: law}).xreplace(truth)

    rates = [composed(e) for e in (*observer.symbolic.right_hand_side, *updates)]
    outputs = [composed(e) for e in estimates]
    move = sp.lambdify((now, [*x, *starts]), rates)
    read = sp.lambdify((now, [*x, *starts]), outputs)
    offsets = np.array(list(START.values())) - read(0.0, [0.0] * (4 + len(starts)))
    solution = solve_ivp(
        move, (0.0, duration), [0.0] * 4 + list(offsets), "Radau", rtol=1e-9, atol=1e-10
    )
    found = np.array(read(duration, solution.y[:, -1]))
    expected = run.parameter_errors[-1] + list(TRUTH.values())
    assert found == pytest.approx(expected, rel=1e-5)
    assert np.abs(expected / list(START.values()) - 1.0).max() > 0.01


def _law(now: sp.Symbol) -> sp.Expr:
    """The controller's law with the reference as a function of time."""
    names = {"x1", "x2", "x3", "x4", "qd", "qd_1", *LAW.parameters, *LAW.definitions}
    law = to_sympy(LAW.inputs["u"], names)
    for _ in LAW.definitions:
        law = law.subs({symbol(n): to_sympy(e, names) for n, e in LAW.definitions.items()})
    waves = zip(AMPLITUDES, FREQUENCIES, PHASES, strict=True)
    reference = sp.Add(*(a * sp.sin(w * now + phase) for a, w, phase in waves))
    law = law.subs({symbol("qd"): reference, symbol("qd_1"): sp.diff(reference, now)})
    return law.subs({symbol(n): value for n, value in LAW.parameters.items()})
