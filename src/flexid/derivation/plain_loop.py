"""Closed loops in plain coordinates: states x and the observer's own states y, z as printed.

The second, independent route: Huang (2003), eqs. (1), (2) and (3) written down side by side, with
no use made of the error dynamics (7). At high gain it is slow and loses digits.
"""

import sympy as sp

from flexid.control.loop import LoopDeclaration
from flexid.derivation.closed_loop import SymbolicLoop, control_law, start_estimates
from flexid.derivation.loop_signals import insert
from flexid.derivation.observer import derive_observer
from flexid.derivation.symbolic import symbol
from flexid.errors import ModelError


def compose_plain_loop(declaration: LoopDeclaration) -> SymbolicLoop:
    """Compose a closed loop in plain coordinates.

    Raises
    ------
    AccelerationError
        If the observer needs an acceleration.
    ModelError
        If it needs a quadrature or the rate of an input.
    """
    observer = derive_observer(declaration.system)
    if observer.quadratures or observer.input_rates:
        names = (*observer.quadratures, *map(str, observer.input_rates))
        raise ModelError(
            declaration.system.name,
            f"has no plain closed loop because of {', '.join(names)}: use the controller's "
            f"coordinates",
        )
    symbolic = observer.symbolic
    signals, law = control_law(declaration, symbolic)
    inputs = tuple(law[u] for u in symbolic.inputs)
    rows = observer.rows
    estimates = {p: e for row in rows for p, e in zip(row.estimates, row.outputs, strict=True)}
    gains = {gain: symbol(f"_gain{place}") for place, gain in enumerate(observer.gains)}
    known = dict(zip(symbolic.inputs, inputs, strict=True))

    def composed(expression: sp.Expr) -> sp.Expr:
        return insert(gains, insert(known, insert(estimates, expression)))

    intermediate = tuple(y for row in rows for y in row.intermediate)
    outputs = tuple(composed(p) for row in rows for p in row.estimates)
    no_offset = dict.fromkeys(intermediate, sp.S.Zero)
    starts = (
        s - insert(no_offset, p) for s, p in zip(start_estimates(symbolic), outputs, strict=True)
    )
    updates = (update for row in rows for update in row.updates)
    tracked = symbol(declaration.controller.tracked)
    return SymbolicLoop(
        declaration,
        signals,
        (*symbolic.states, *intermediate),
        (*symbolic.states, *starts),
        tuple(composed(rate) for rate in (*symbolic.right_hand_side, *updates)),
        symbolic.states,
        inputs,
        outputs,
        tuple(e - p for e, p in zip(outputs, symbolic.coefficients, strict=True)),
        tracked - signals.reference(0),
        tuple(insert(known, r) for row in symbolic.rows for r in row.regressor),
    )
