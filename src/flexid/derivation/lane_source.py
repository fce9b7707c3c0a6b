"""Closed loops as source for several runs side by side; see the template ``lanes``.

What is one number in the other sources is one per lane here, at a place of the array ``_w``.
"""

from collections.abc import Mapping, Sequence
from textwrap import indent

import sympy as sp

from flexid.derivation.closed_loop import SymbolicLoop
from flexid.derivation.loop_source import loop_body, loop_source, parameters
from flexid.derivation.source import function

# Products and sums in one instruction: faster, and no less accurate.
_FUSED = 'njit(cache=True, error_model="numpy", fastmath={"contract"})'


def lane_loop_source(loop: SymbolicLoop, lanes: int) -> str:
    """Print what an explicit integrator of several runs needs of a loop."""
    observed = [*loop.inputs, *loop.errors, loop.tracking_error, *loop.regressors]
    rates = _targets("RATES", loop.rates)
    return "\n\n".join(
        (
            loop_source(loop) + f"\nN_OBSERVED = {len(observed)}\nLANES = {lanes}\n",
            _lane_function(
                loop, "lane_rates(_w)", "RATES at every lane's STAGE and STAGE_TIME.", rates
            ),
            _lane_function(
                loop,
                "lane_rates_and_outputs(_w)",
                "RATES and NEXT_OBSERVED at every lane's STAGE and STAGE_TIME.",
                rates | _targets("NEXT_OBSERVED", observed),
            ),
        )
    )


def _lane_function(
    loop: SymbolicLoop, signature: str, docstring: str, results: Mapping[str, sp.Expr]
) -> str:
    blocks = {"STAGE": loop.variables, "PARAMETERS": parameters(loop.declaration)}
    places = {
        name: _number(f"{start} + {place}")
        for start, names in blocks.items()
        for place, name in enumerate(names)
    }
    body = loop_body(loop.signals, places, _number("STAGE_TIME"), results)
    lanes = "    for _lane in range(LANES):\n" + indent(body, "    ")
    return function(signature, docstring, lanes, decorator=_FUSED)


def _targets(start: str, expressions: Sequence[sp.Expr]) -> dict[str, sp.Expr]:
    return {_number(f"{start} + {i}"): value for i, value in enumerate(expressions)}


def _number(slot: str) -> str:
    return f"_w[at({slot}, _lane)]"
