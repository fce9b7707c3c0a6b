"""The estimator in C99: its header and its source, from templates and the model's functions."""

import hashlib
from functools import cached_property
from math import exp

from flexid.derivation.drive_source import MACROS, comment, drive_functions
from flexid.errors import SettingError
from flexid.estimators.parametric_observer import ParametricObserver
from flexid.estimators.recursive_least_squares import RecursiveLeastSquares
from flexid.exports.request import EstimatorSettings, ExportSource, rendered
from flexid.models.parametric_system import Row

LARGEST_SAMPLE = 1e9
"""A number in a sample beyond this, in its unit, is a fault of the sensor."""

MOST_COEFFICIENTS = 31
"""Of a row: which of them are determined stands in the bits of one number."""

_RECENT = 10.0  # time constants of the filter that "lately" reaches back over
_RECENT_TIME = 0.5  # s, where there is no filter


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

    @property
    def constant(self) -> bool:
        """Whether the gain is constant."""
        return isinstance(self.twin, ParametricObserver)

    @property
    def counts(self) -> list[int]:
        """Number of coefficients of each row."""
        return [len(row.coefficients) for row in self.system.rows]

    @property
    def row_starts(self) -> list[int]:
        """Where the coefficients of each row begin, and where the last ones end."""
        return [0, *(part.stop for _, part in self.system.row_slices())]

    @cached_property
    def start(self) -> dict[str, float]:
        """Each coefficient as the estimation begins."""
        begun = self.twin.coefficients(self.twin.init(self.settings.start)).tolist()
        return dict(zip(self.system.coefficients, begun, strict=True))

    @property
    def calls(self) -> list[str]:
        """Functions of math.h that the source calls, as macros."""
        used = self.functions.calls | {"FABS"} | (set() if self.constant else {"SQRT"})
        return [name for name in MACROS if name in used]

    @property
    def held_input(self) -> str:
        """The sample whose input acts until the next one."""
        return "state->latest" if self.settings.hold == "zero" else "latest"

    @property
    def recent_weight(self) -> float:
        """Weight of the latest sample in what is called recent."""
        h = self.settings.sample_time
        filtered = isinstance(self.twin, RecursiveLeastSquares) and not self.settings.velocities
        spans = h * self.settings.filter_rate / _RECENT if filtered else h / _RECENT_TIME
        return 1.0 - exp(-spans)

    def unit(self, coefficient: str) -> str:
        """Unit of a coefficient, for a comment."""
        return self._units.get(coefficient) or "in the model's unit"

    def sample_unit(self, name: str) -> str:
        """Unit of what a sample holds, for a comment."""
        if not self._units:
            return "in the model's unit"
        if name in self.system.inputs:
            return comment(self._units.get(name) or "the input, in the model's unit")
        return "rad/s" if name in self.system.states[1::2] else "rad"

    def equation(self, row: Row) -> str:
        """The right-hand side of a row, as eq. (1) has it."""
        terms = [f"{name}*({text})" for name, text in row.regressors.items()]
        return " + ".join([*terms, *[row.known] * (row.known != "0")])

    def header(self) -> str:
        """Text of ``flexid_drive.h``."""
        parts = (self.source(), self.text("state.h").rstrip(), self.text("sizes.h").rstrip())
        decisive = "".join(parts)
        version = int.from_bytes(hashlib.sha256(decisive.encode()).digest()[:4])
        return self.text("drive.h", version=version, version_float=version ^ 0xFFFFFFFF)

    def source(self) -> str:
        """Text of ``flexid_drive.c``."""
        return self.text("drive.c")

    def text(self, name: str, **more: object) -> str:
        """A template filled for this estimator."""
        law = None if isinstance(self.twin, ParametricObserver) else self.twin.law
        settings = self.settings
        return rendered(
            f"c99/{name}",
            drive=self,
            settings=settings,
            law=law,
            velocities=settings.velocities,
            largest=LARGEST_SAMPLE,
            **more,
        )
