"""Source of one sampling interval of the parametric observer, for the estimators' kernel.

Everything is a tuple of scalars: compiled, the tuples dissolve into registers, where arrays would
be stored and loaded again at every sample (28 against 84 ns, measured on the flexible joint).

    state     started (0 or 1), coefficients, then of the last sample: regressors, known parts,
              velocities, inputs
    sample    coordinate and velocity of each row in turn, inputs
    settings  sample time, whether inputs are held (0 or 1), gains, constants
"""

from collections.abc import Sequence

from flexid.derivation.model_functions import module_header
from flexid.derivation.source import assignments, function, row_function, tuple_text
from flexid.derivation.symbolic import SymbolicSystem, symbolic_system
from flexid.models.parametric_system import ParametricSystem


def sampled_observer_functions(system: ParametricSystem, purpose: str) -> str:
    """Header, and ``advance`` with what turns arrays into its tuples."""
    symbolic = symbolic_system(system)
    state, sample, settings = _layout(symbolic)
    sizes = f"STATE_SIZE = {len(state)}\nSAMPLE_SIZE = {len(sample)}\n"
    return "\n\n".join(
        (
            module_header(system, purpose) + sizes,
            _advance_function(symbolic),
            _tuple_function("as_state", "State", len(state)),
            row_function("as_sample", "Sample _n", len(sample), "inner"),
            _tuple_function("as_settings", "Settings", len(settings)),
        )
    )


def _layout(symbolic: SymbolicSystem) -> tuple[list[str], list[str], list[str]]:
    """Local names of the state, the sample and the settings, in order."""
    coefficients, rows = _r(symbolic.coefficients), _r(symbolic.rows)
    last = [f"_r{i}" for i in coefficients] + [f"_k{j}" for j in rows] + [f"_v{j}" for j in rows]
    last += [f"_u{j}" for j in _r(symbolic.inputs)]
    state = ["_started", *map(str, symbolic.coefficients), *last]
    sample = [str(name) for name in (*symbolic.states, *symbolic.inputs)]
    settings = ["_h", "_held", *(f"_g{i}" for i in coefficients), *map(str, symbolic.constants)]
    return state, sample, settings


def _advance_function(symbolic: SymbolicSystem) -> str:
    state, sample, settings = _layout(symbolic)
    inputs = [str(name) for name in symbolic.inputs]
    coefficients = [str(name) for name in symbolic.coefficients]
    rows = _r(symbolic.rows)
    velocities = [str(row.velocity) for row in symbolic.rows]
    ends = [f"_a{i}" for i in _r(symbolic.coefficients)] + [f"_b{j}" for j in rows]
    expressions = [r for row in symbolic.rows for r in row.regressor]
    expressions += [row.known for row in symbolic.rows]
    held = [f"        {name} = _u{j}" for j, name in enumerate(inputs)] or ["        pass"]
    current = [f"        {name} = _now{j}" for j, name in enumerate(inputs)]
    return function(
        "advance(_state, _sample, _settings)",
        "State after one more sample, and each row's innovation.",
        f"    {tuple_text(state)} = _state\n    {tuple_text(sample)} = _sample",
        f"    {tuple_text(settings)} = _settings",
        "\n".join(f"    _now{j} = {name}" for j, name in enumerate(inputs)),
        "    if _held != 0.0 and _started != 0.0:",
        "\n".join(held),
        assignments(ends, expressions),
        "    if _started != 0.0:",
        "\n".join(_row_update(symbolic, j) for j in rows),
        "    else:",
        "\n".join(f"        _i{j} = np.nan" for j in rows),
        "    if _held != 0.0:",
        "\n".join([*current, assignments(ends, expressions, "        ")]),
        f"    _state = {tuple_text(['1.0', *coefficients, *ends, *velocities, *inputs])}",
        f"    return _state, {tuple_text([f'_i{j}' for j in rows])}",
        decorator="inner",
    )


def _row_update(symbolic: SymbolicSystem, place: int) -> str:
    """Lines that bring one row's coefficients over the interval.

    p' = G r (v' - rᵀp - k), Huang (2003), eqs. (2)-(3), with the regressor r̄ of the middle of the
    interval. Along G r̄ the error decays by exp(-s), s = h r̄ᵀG r̄; that is replaced by
    1/(1 + s + s²/2), which agrees to second order and stays between 0 and 1 for any s.
    """
    rows = symbolic.rows
    row = rows[place]
    start = sum(len(before.coefficients) for before in rows[:place])
    places = range(start, start + len(row.coefficients))
    names = [str(name) for name in row.coefficients]
    predicted = [f"_m{i} * {name}" for i, name in zip(places, names, strict=True)]
    squares = [f"_g{i} * _m{i} * _m{i}" for i in places]
    lines = [f"_m{i} = 0.5 * (_r{i} + _a{i})" for i in places]
    lines += [
        f"_s = _h * ({' + '.join(squares)})",
        f"_i{place} = {row.velocity} - _v{place} - _h * (0.5 * (_k{place} + _b{place})"
        f" + {' + '.join(predicted)})",
        f"_c = _i{place} * (1.0 + 0.5 * _s) / (1.0 + _s * (1.0 + 0.5 * _s))",
    ]
    lines += [f"{name} += _g{i} * _m{i} * _c" for i, name in zip(places, names, strict=True)]
    return "\n".join(f"        {line}" for line in lines)


def _tuple_function(name: str, what: str, size: int) -> str:
    body = f"    return {tuple_text([f'_array[{i}]' for i in range(size)])}"
    return function(f"{name}(_array)", f"{what} as a tuple.", body, decorator="inner")


def _r(sequence: Sequence[object]) -> range:
    return range(len(sequence))
