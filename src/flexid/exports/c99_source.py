"""The estimator in C99: its header and its source, from templates and the model's functions."""

import hashlib
from collections.abc import Iterable, Mapping
from math import exp

from flexid.derivation.drive_source import MACROS, comment, drive_functions
from flexid.errors import SettingError
from flexid.estimators.parametric_observer import ParametricObserver
from flexid.estimators.recursive_least_squares import RecursiveLeastSquares
from flexid.exports.request import EstimatorSettings, ExportSource, filled, template_text
from flexid.models.parametric_system import ParametricSystem

LARGEST_SAMPLE = 1e9
"""A number in a sample beyond this, in its unit, is a fault of the sensor."""

MOST_COEFFICIENTS = 31
"""Of a row: which of them are determined stands in the bits of one number."""

_RECENT = 10.0  # time constants of the filter that "lately" reaches back over
_RECENT_TIME = 0.5  # s, where there is no filter
_SLACK = 0.01  # unexplained part of the recent left-hand sides that contradicts nothing
_UNUSUAL = 10.0  # and how many times the usual part
_STANDSTILL = 0.01  # part of the mean square below which a motion cannot contradict a model
_PATIENCE = 8  # times as long before what is still open is open because of the motion
_SLOWEST = 0.1  # 1/s; an observer that converges more slowly is not excited


class DriveSource:
    """Header and source of one estimator."""

    def __init__(self, source: ExportSource, settings: EstimatorSettings) -> None:
        self.system = source.system
        for row in self.system.rows:
            if len(row.coefficients) > MOST_COEFFICIENTS:
                raise SettingError(
                    row.name,
                    f"has {len(row.coefficients)} coefficients, more than the {MOST_COEFFICIENTS} "
                    f"of a row that an estimator in C takes: leave some out",
                )
        self.settings = settings
        self.twin = settings.twin(source.system)
        self.functions = drive_functions(source.system, not settings.velocities)
        self._units = source.units

    @property
    def names(self) -> dict[str, str]:
        """Identifier in C of each state, input and coefficient."""
        return self.functions.names

    @property
    def sample_names(self) -> tuple[str, ...]:
        """What a sample holds, in order."""
        states = self.system.states
        measured = states if self.settings.velocities else states[::2]
        return (*measured, *self.system.inputs)

    def header(self) -> str:
        """Text of ``flexid_drive.h``."""
        digest = hashlib.sha256((self.source() + self._state() + self._sizes()).encode()).digest()
        double = int.from_bytes(digest[:4])
        return filled(
            "c99/drive.h",
            model=comment(self.system.name),
            method=self.settings.summary,
            rows="\n".join(_equations(self.system)),
            version_double=f"0x{double:08X}",
            version_float=f"0x{double ^ 0xFFFFFFFF:08X}",
            sizes=self._sizes(),
            sample_time=repr(self.settings.sample_time),
            sample_members="\n".join(
                f"    flexid_real {self.names[n]}; /* {self._sample_unit(n)} */"
                for n in self.sample_names
            ),
            value_members="\n".join(
                f"    flexid_real {self.names[n]}; /* {comment(self._unit(n))}, of {regressor} */"
                for row in self.system.rows
                for n, regressor in ((n, comment(text)) for n, text in row.regressors.items())
            ),
            state=self._state(),
        )

    def source(self) -> str:
        """Text of ``flexid_drive.c``."""
        names = ["common.c", *self._kind, "step.c"]
        return "".join(filled(f"c99/{name}", **self._placeholders()) for name in names)

    @property
    def _kind(self) -> tuple[str, ...]:
        if isinstance(self.twin, ParametricObserver):
            return ("constant_gain.c",)
        rows = "rows_velocities.c" if self.settings.velocities else "rows_positions.c"
        return "triangle.c", rows, "least_squares.c"

    def _state(self) -> str:
        if isinstance(self.twin, ParametricObserver):
            return template_text("c99/state_constant.h")
        kind = "velocities" if self.settings.velocities else "positions"
        return (
            template_text("c99/state_row.h") + "\n" + template_text(f"c99/state_{kind}.h").rstrip()
        )

    def _sizes(self) -> str:
        system, twin = self.system, self.twin
        counts = [len(row.coefficients) for row in system.rows]
        sizes = {
            "ROWS": len(counts),
            "COEFFICIENTS": sum(counts),
            "SIGNALS": sum(counts) + len(counts),
            "SAMPLE_SIZE": len(self.sample_names),
        }
        if isinstance(twin, RecursiveLeastSquares):
            sizes["WIDTH"] = max(counts) + 2 * (not self.settings.velocities)
            if not self.settings.velocities:
                sizes["WINDOW"] = 2 * twin.law.half_window + 3
        lines = [f"#define FLEXID_{name} {value}U" for name, value in sizes.items()]
        largest = f"#define FLEXID_LARGEST ((flexid_real){LARGEST_SAMPLE!r})"
        return "\n".join([*lines, f"{largest} /* of a sample, in its unit */"])

    def _placeholders(self) -> dict[str, str]:
        system, names = self.system, self.names
        last = len(self.sample_names) - 1
        places = [0, *(part.stop for _, part in system.row_slices())]
        start = self.twin.coefficients(self.twin.init(self.settings.start)).tolist()
        values = {
            "float_macros": _macros(self._calls, "f"),
            "double_macros": _macros(self._calls, ""),
            "settings": self._settings_text(),
            "start": _entries(
                (
                    (_real(value), f"{name}, {self._unit(name)}")
                    for name, value in zip(system.coefficients, start, strict=True)
                ),
                indent="        ",
            ),
            "row_starts": ", ".join(f"{place}U" for place in places),
            "turns": template_text(
                "c99/turns_all.c"
                if self.settings.velocities or len(system.rows) == 1
                else "c99/turns_float.c"
            ),
            "model_functions": self._model_functions(),
            "latest": "\n".join(
                f"        sample->{names[n]}{',' if i < last else ''}"
                for i, n in enumerate(self.sample_names)
            ),
            "estimates": self._estimates_text(),
            "input_at_end": f"&{self._held_input}[2U * FLEXID_ROWS]",
        }
        if isinstance(self.twin, ParametricObserver):
            gains = zip(system.coefficients, self.twin.gains.tolist(), strict=True)
            entries = ((_real(gain), f"of {name}") for name, gain in gains)
            values["gains"] = _entries(entries, indent="        ")
        elif not self.settings.velocities:
            half = self.twin.law.half_window
            values["held"] = ", ".join("true" if h else "false" for h in self.functions.held)
            values["middle_state"] = template_text(
                "c99/middle_slopes.c" if half else "c99/middle_positions.c"
            )
            values["signals_end"] = template_text(
                "c99/end_held.c" if self.settings.hold == "zero" else "c99/end_linear.c"
            ).rstrip()
        return values

    @property
    def _held_input(self) -> str:
        return "state->latest" if self.settings.hold == "zero" else "latest"

    @property
    def _calls(self) -> frozenset[str]:
        own = {"FABS"} if isinstance(self.twin, ParametricObserver) else {"FABS", "SQRT"}
        return self.functions.calls | own

    def _unit(self, coefficient: str) -> str:
        return self._units.get(coefficient) or "in the model's unit"

    def _sample_unit(self, name: str) -> str:
        if not self._units:
            return "in the model's unit"
        if name in self.system.inputs:
            return comment(self._units.get(name) or "the input, in the model's unit")
        return "rad/s" if name in self.system.states[1::2] else "rad"

    def _model_functions(self) -> str:
        sign = "sign_of(" in self.functions.source
        return "\n".join([*([template_text("c99/sign.c")] * sign), self.functions.source])

    def _estimates_text(self) -> str:
        lines = []
        for j, (row, part) in enumerate(self.system.row_slices()):
            for i, name in enumerate(row.coefficients):
                place = f"row[{j}].unknown[{i}]"
                if isinstance(self.twin, ParametricObserver):
                    place = f"value[{part.start + i}]"
                lines.append(f"    values->{self.names[name]} = state->{place};")
        return "\n".join(lines)

    def _settings_text(self) -> str:
        h, filter_rate = self.settings.sample_time, self.settings.filter_rate
        counts: dict[str, int] = {}
        numbers: dict[str, float] = {}
        pairs = {"LARGEST_POWER": (1e300, 1e36)}  # in double, in float
        recent = h / _RECENT_TIME
        if self.settings.velocities:
            numbers["SAMPLE_TIME"] = h
        if isinstance(self.twin, ParametricObserver):
            numbers["SLOWEST"] = _SLOWEST
        else:
            law = self.twin.law
            counts |= {"FEWEST": law.fewest, "PATIENCE": _PATIENCE * law.fewest}
            kept = (1.0 - law.fading) * law.least_information
            numbers |= {
                "FADING": law.fading,
                "FORGOTTEN": 1.0 - law.fading,
                "KEPT": kept,
                "LEAST_TOLERANCE": law.least_tolerance,
                "LEAST_EXPLAINED": law.least_explained,
                "SLACK": _SLACK,
                "UNUSUAL": _UNUSUAL,
                "STANDSTILL": _STANDSTILL,
            }
            pairs |= {"RIDGE": (law.ridge, 1e-6), "LEAST_DIAGONAL": (1e-200, 1e-30)}
            pairs["LEAST_SQUARE"] = (1e-16, 1e-7)
            if not self.settings.velocities:
                pairs["LEAST_PIVOT"] = (1e-12, 1e-6)
                recent = h * filter_rate / _RECENT
                counts |= {"MEMORY": law.memory, "HALF_WINDOW": law.half_window}
                counts["MIDDLE"] = law.half_window + 2
                if law.half_window:
                    half = law.half_window
                    weight = half * (half + 1) * (2 * half + 1) / 3.0
                    numbers["SLOPE_WEIGHT"] = weight
                numbers |= {
                    "SAMPLES_PER_SECOND": 1.0 / h,
                    "POLE": law.pole,
                    "ONE_LESS_POLE": 1.0 - law.pole,
                }
        numbers["RECENT"] = 1.0 - exp(-recent)
        return _definitions(counts, numbers, pairs)


_MEANINGS = {
    "LARGEST_POWER": "beyond it a sum is taken for an overflow",
    "SAMPLE_TIME": "h, s",
    "FADING": "mu, by which what was learnt fades per sample",
    "FORGOTTEN": "1 - mu",
    "KEPT": "(1 - mu) of the part of the largest A[i][i] that is never forgotten",
    "RIDGE": "rho",
    "LEAST_TOLERANCE": "part of a regressor's square that the others must leave over",
    "LEAST_EXPLAINED": "part of a left-hand side that a row must explain",
    "LEAST_DIAGONAL": "below it a sum of squares counts as zero",
    "LEAST_SQUARE": "part of A[i][i] that a factor's diagonal has at least, squared",
    "SLACK": "unexplained part of the latest left-hand sides that contradicts nothing",
    "UNUSUAL": "and how many times the usual part",
    "STANDSTILL": "part of the mean square below which a motion contradicts nothing",
    "SAMPLES_PER_SECOND": "1/h, 1/s",
    "POLE": "of the filter lambda^2/(s + lambda)^2, exp(-lambda h)",
    "ONE_LESS_POLE": "1 - POLE",
    "LEAST_PIVOT": "part of the other past unknown's square that one must have",
    "RECENT": "weight of the latest sample in what is called recent",
    "SLOWEST": "1/s; where r^T G r is less, nothing converges",
    "FEWEST": "equations before anything is called determined",
    "PATIENCE": "equations after which what is still open is open because of the motion",
    "MEMORY": "equations after which the filter remembers nothing of the time before a gap",
    "HALF_WINDOW": "samples to either side that a velocity is the slope over",
    "SLOPE_WEIGHT": "sum of squares of the distances that a slope is taken over",
    "MIDDLE": "the place in the window that equations are for",
}


def _definitions(
    counts: Mapping[str, int],
    numbers: Mapping[str, float],
    pairs: Mapping[str, tuple[float, float]],  # in double, in float
) -> str:
    lines = [f"#define {name} {n}U /* {_MEANINGS[name]} */" for name, n in counts.items()]
    lines += [f"#define {name} {_real(v)} /* {_MEANINGS[name]} */" for name, v in numbers.items()]
    for guard, place in (("#if defined(FLEXID_FLOAT)", 1), ("#else", 0)):
        lines.append(guard)
        lines += [
            f"#define {name} {_real(pair[place])} /* {_MEANINGS[name]} */"
            for name, pair in pairs.items()
        ]
    return "\n".join([*lines, "#endif"])


def _real(value: float) -> str:
    return f"REAL({value!r})" if value >= 0.0 else f"(-REAL({-value!r}))"


def _entries(values: Iterable[tuple[str, str]], indent: str = "    ") -> str:
    pairs = list(values)
    last = len(pairs) - 1
    return "\n".join(
        f"{indent}{value}{',' if i < last else ''} /* {comment(text)} */"
        for i, (value, text) in enumerate(pairs)
    )


def _macros(calls: Iterable[str], suffix: str) -> str:
    used = [name for name in MACROS if name in calls]
    return "\n".join(f"#define {name} {name.lower()}{suffix}" for name in used)


def _equations(system: ParametricSystem) -> list[str]:
    """The rows as eq. (1) has them, for the header's comment."""
    lines = []
    for row in system.rows:
        terms = [f"{name}*({text})" for name, text in row.regressors.items()]
        terms += [row.known] * (row.known != "0")
        lines.append(
            f" *   {row.velocity}' = {comment(' + '.join(terms))}   eq. (1), {comment(row.name)}"
        )
    constants = ", ".join(f"{name} = {value!r}" for name, value in system.constants.items())
    return [*lines, *([f" *   with {constants}"] * bool(constants))]
