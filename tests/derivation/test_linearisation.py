"""The linearisation that is printed, against differences of the printed right-hand side."""

from types import ModuleType

import numpy as np
import pytest
from systems import ALL

from flexid.derivation.model_functions import linear_model, moving_model


@pytest.mark.parametrize("name", ALL)
def test_linearisation_is_the_slope_of_the_right_hand_side(
    name: str, monkeypatch: pytest.MonkeyPatch
):
    """Assert that every derivative is the limit of differences, and that nothing smooth jumps."""
    monkeypatch.setattr("numba.njit", lambda **_: lambda function: function)
    module = ModuleType("moving")
    exec(compile(moving_model(ALL[name], "Test"), "moving", "exec"), module.__dict__)
    generator = np.random.default_rng(1)
    sizes = (module.N_STATES, module.N_INPUTS, module.N_COEFFICIENTS)
    x, u, p = (generator.normal(size=size) for size in sizes)
    c = np.array(list(ALL[name].constants.values()))
    found, jumps = np.empty((len(x), len(x))), np.empty(module.N_ROWS)
    module.linearised(x, u, p, c, found, jumps)
    step, rates = 1e-5, np.empty((2, len(x)))
    for place in range(len(x)):
        for side, nudge in enumerate((step, -step)):
            moved = x.copy()
            moved[place] += nudge
            module.right_hand_side(moved, u, p, c, rates[side])
        slope = (rates[0] - rates[1]) / (2.0 * step)
        # The differences err by step²/6 of the third derivative.
        np.testing.assert_allclose(found[:, place], slope, rtol=1e-6, atol=1e-6)
    again, gains = np.empty_like(found), np.empty((len(x), len(u)))
    exec(linear_model(ALL[name]), plain := {})
    plain["slopes"](x.tolist(), u.tolist(), p.tolist(), c.tolist(), again, gains)
    np.testing.assert_allclose(again, found, rtol=1e-14)
    for place in range(len(u)):
        for side, nudge in enumerate((step, -step)):
            moved = u.copy()
            moved[place] += nudge
            module.right_hand_side(x, moved, p, c, rates[side])
        slope = (rates[0] - rates[1]) / (2.0 * step)
        np.testing.assert_allclose(gains[:, place], slope, rtol=1e-6, atol=1e-6)
    assert not jumps.any()
