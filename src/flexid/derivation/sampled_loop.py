"""Source of a sampled-data loop: sensors, control law, observer and plant, sample by sample.

As in the observer's own kernel everything is a tuple of scalars, so that a sample stays in
registers. The plant moves by the classical Runge-Kutta method under a constant input.
"""

from collections.abc import Callable, Sequence

from flexid.control.loop import LoopDeclaration
from flexid.derivation.closed_loop import control_law
from flexid.derivation.loop_source import loop_function
from flexid.derivation.model_functions import regressor_function
from flexid.derivation.sampled_observer import sampled_observer_functions
from flexid.derivation.source import function, row_function, tuple_text
from flexid.derivation.symbolic import SymbolicSystem, symbolic_system


def sampled_loop_source(declaration: LoopDeclaration) -> str:
    """Source of the functions that the template ``sampled_loop`` needs."""
    system = declaration.system
    symbolic = symbolic_system(system)
    signals, law = control_law(declaration, symbolic)
    purpose = f"Sampled loop with {declaration.controller.name!r}"
    states, inputs = len(symbolic.states), len(symbolic.inputs)
    demanded = {f"_u{i}": law[u] for i, u in enumerate(symbolic.inputs)}
    demanded["_reference"] = signals.reference(0)
    rates = {f"_d{i}": rate for i, rate in enumerate(symbolic.right_hand_side)}
    return "\n\n".join(
        (
            sampled_observer_functions(system, purpose) + _sizes(declaration),
            regressor_function(symbolic),
            row_function("as_states", "Values of all states", states),
            row_function("as_parameters", "Parameters", len(declaration.parameter_names)),
            _sense_function(states),
            loop_function(
                declaration,
                signals,
                "control(_t, _x, _p)",
                "Inputs that the law demands at time _t for the measured states, and q_d.",
                {"_x": symbolic.states},
                demanded,
                f"    return {tuple_text(_names('_u', inputs))}, _reference",
            ),
            _saturate_function(inputs),
            loop_function(
                declaration,
                signals,
                "plant_rates(_x, _u, _p)",
                "x' of the plant.  # Huang (2003), eq. (1)",
                {"_x": symbolic.states, "_u": symbolic.inputs},
                rates,
                f"    return {tuple_text(list(rates))}",
            ),
            _plant_step_function(symbolic),
        )
    )


def _sizes(declaration: LoopDeclaration) -> str:
    system = declaration.system
    starts = (0, *(part.stop for _, part in system.row_slices()))
    tracked = system.states.index(declaration.controller.tracked)
    return f"\nROW_STARTS = {starts}\nTRACKED = {tracked}\n"


def _sense_function(states: int) -> str:
    """Every state with its noise, positions in whole encoder steps."""
    true, seen, draws = (_names(stem, states) for stem in ("_x", "_s", "_d"))
    deviations = ["_position", "_velocity"] * (states // 2)
    noisy = [
        f"    {s} = {x} + {deviation} * {d}"
        for s, x, d, deviation in zip(seen, true, draws, deviations, strict=True)
    ]
    whole = [f"        {s} = _step * np.floor({s} / _step + 0.5)" for s in seen[::2]]
    return function(
        "sense(_state, _draws, _position, _velocity, _step)",
        "What the sensors show, given standard normal numbers.",
        f"    {tuple_text(true)} = _state\n    {tuple_text(draws)} = _draws",
        "\n".join(noisy),
        "    if _step > 0.0:",
        "\n".join(whole),
        f"    return {tuple_text(seen)}",
    )


def _saturate_function(inputs: int) -> str:
    names = _names("_u", inputs)
    lines = [
        f"    if abs({u}) > _limit:\n        {u} = copysign(_limit, {u})\n        _clipped = 1"
        for u in names
    ]
    return function(
        "saturate(_inputs, _limit)",
        "Inputs clipped to the limit, and 1 if one was.",
        f"    {tuple_text(names)} = _inputs\n    _clipped = 0",
        "\n".join(lines),
        f"    return {tuple_text(names)}, _clipped",
    )


def _plant_step_function(symbolic: SymbolicSystem) -> str:
    size = len(symbolic.states)
    x, stages = _names("_x", size), [_names(f"_{s}", size) for s in "abcd"]
    a, b, c, d = stages

    def stage(names: Sequence[str], state: Callable[[int], str]) -> str:
        point = tuple_text([state(i) for i in range(size)])
        return f"    {tuple_text(names)} = plant_rates({point}, _u, _p)"

    after = [f"{x[i]} + _sixth * ({a[i]} + 2.0 * ({b[i]} + {c[i]}) + {d[i]})" for i in range(size)]
    return function(
        "plant_step(_state, _u, _p, _h)",
        "State after a step of the classical Runge-Kutta method.",
        f"    {tuple_text(x)} = _state\n    _half = 0.5 * _h\n    _sixth = _h / 6.0",
        stage(a, lambda i: x[i]),
        stage(b, lambda i: f"{x[i]} + _half * {a[i]}"),
        stage(c, lambda i: f"{x[i]} + _half * {b[i]}"),
        stage(d, lambda i: f"{x[i]} + _h * {c[i]}"),
        f"    return {tuple_text(after)}",
    )


def _names(stem: str, size: int) -> list[str]:
    return [f"{stem}{i}" for i in range(size)]
