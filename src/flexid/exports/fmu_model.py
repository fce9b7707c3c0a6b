"""What goes into an FMU: the plant or the estimator, as variables and C sources."""

import hashlib
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np

from flexid.derivation.drive_source import plant_rates
from flexid.errors import SettingError
from flexid.exports.c99_source import DriveSource
from flexid.exports.request import EstimatorSettings, ExportSource, rendered
from flexid.kernels.templates.bound import BOUND
from flexid.models.parametric_system import ParametricSystem
from flexid.models.terms import COULOMB_VELOCITY, SMOOTHING
from flexid.simulation.substeps import STEPS_PER_TIME_CONSTANT, fastest_pole

FIRST_INTEGER = 1001
"""Value reference of the first integer output."""

Causality = Literal["independent", "output", "input", "parameter"]

HEALTH = ("converging", "converged", "not excited", "inconsistent", "sensor fault")
"""What the numbers of the estimator's health mean, from 0 on."""


@dataclass(frozen=True)
class Variable:
    """A variable of an FMU."""

    name: str
    causality: Causality  # parameters can be changed between communication steps
    start: float | None  # None: only a step gives it
    unit: str = ""
    description: str = ""
    integer: bool = False

    @property
    def variability(self) -> str:
        """When it may change."""
        if self.causality == "parameter":
            return "tunable"
        return "discrete" if self.integer else "continuous"

    @property
    def initial(self) -> str:
        """How it is initialised; empty where the standard says it."""
        if self.causality in ("independent", "input"):
            return ""
        return "calculated" if self.start is None else "exact"


@dataclass(frozen=True, eq=False)
class FmuModel:
    """A model for co-simulation."""

    identifier: str  # "plant" or "estimator": also the name of the compiled library
    description: str
    variables: tuple[Variable, ...]  # outputs, inputs, parameters; then integer outputs
    sources: dict[str, str] = field(repr=False)  # C files by name, without model.h
    includes: tuple[str, ...]  # of model.h
    own: str  # further members of the model's struct
    step: float  # s, of communication: the only one if it is fixed, else a usual one
    fixed_step: bool  # any other step is refused

    def __post_init__(self) -> None:
        names = ["time", *(v.name for v in self.variables)]
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice is not None:
            raise SettingError(
                "fmu", f"has a variable of its own that is called {twice!r}: rename the model's"
            )

    @property
    def reals(self) -> tuple[Variable, ...]:
        """Those that are no integers; the value reference of each is its place plus 1."""
        return tuple(v for v in self.variables if not v.integer)

    def reference(self, variable: Variable) -> int:
        """Value reference of a variable."""
        if variable.integer:
            return FIRST_INTEGER + [v for v in self.variables if v.integer].index(variable)
        return 1 + self.reals.index(variable)

    @cached_property
    def token(self) -> str:
        """What an importer has to name: it changes with everything that the FMU does."""
        content = hashlib.sha256()
        for text in (repr(self.variables), repr(self.step), *self.sources.values()):
            content.update(text.encode() + b"\0")
        digits = content.hexdigest()
        parts = (digits[:8], digits[8:12], digits[12:16], digits[16:20], digits[20:32])
        return f"{{{'-'.join(parts)}}}"

    def count(self, causality: Causality) -> int:
        """Number of reals of a causality."""
        return sum(v.causality == causality for v in self.reals)

    def header(self) -> str:
        """Text of ``model.h``."""
        return rendered("fmu/model.h", model=self, first_integer=FIRST_INTEGER)


def plant_model(source: ExportSource) -> FmuModel:
    """The model with its values, as a plant."""
    system = without_jumps(source.system)
    missing = [name for name in system.coefficients if name not in source.values]
    if missing:
        raise SettingError(
            "fmu",
            f"the plant needs values of {', '.join(missing)}: export an estimate, or add "
            f"--sample-time for the online estimator",
        )
    values = {name: float(source.values[name]) for name in system.coefficients}
    variables = (
        *(
            Variable(name, "output", 0.0, unit, what)
            for row in system.rows
            for name, unit, what in (
                (row.coordinate, "rad", f"position of the {row.name}"),
                (row.velocity, "rad/s", f"velocity of the {row.name}"),
            )
        ),
        *(
            Variable(name, "input", 0.0, source.units.get(name, ""), "held over a step")
            for name in system.inputs
        ),
        *(
            Variable(name, "parameter", value, source.units.get(name, ""), regressor)
            for row in system.rows
            for name, regressor in row.regressors.items()
            for value in (values[name],)
        ),
        *(
            Variable(name, "parameter", value, source.units.get(name, ""))
            for name, value in system.constants.items()
        ),
    )
    text = rendered(
        "fmu/plant.c",
        system=system,
        steps_per_second=STEPS_PER_TIME_CONSTANT * _fastest(system, values),
        bound=BOUND,
        variables=variables,
        rates=plant_rates(system),
    )
    title = f"{system.name}: the plant, from its inputs to its states"
    return FmuModel("plant", title, variables, {"plant.c": text}, (), "", 1e-3, False)


def estimator_model(source: ExportSource, settings: EstimatorSettings) -> FmuModel:
    """The online estimator of ``--to c99``, one sample for each communication step."""
    drive = DriveSource(source, settings)
    states = drive.system.states
    state_units = dict.fromkeys(states[::2], "rad") | dict.fromkeys(states[1::2], "rad/s")
    variables = (
        *(
            Variable(f"{name}_hat", "output", None, source.units.get(name, ""), "estimate")
            for name in drive.system.coefficients
        ),
        *(
            Variable(name, "input", 0.0, unit, "sample")
            for name in drive.sample_names
            for unit in (state_units.get(name, source.units.get(name, "")),)
        ),
        Variable("health", "output", None, "", _health(), integer=True),
    )
    text = rendered("fmu/estimator.c", drive=drive, settings=settings)
    return FmuModel(
        "estimator",
        f"{drive.system.name}: {settings.summary}",
        variables,
        {"estimator.c": text, "flexid_drive.c": drive.source(), "flexid_drive.h": drive.header()},
        ("flexid_drive.h",),
        "    flexid_state state;\n",
        settings.sample_time,
        True,
    )


def without_jumps(system: ParametricSystem) -> ParametricSystem:
    """The same with the sign of a row's own velocity smoothed as Coulomb friction is."""
    rows = tuple(
        replace(
            row,
            regressors={
                c: text.replace(f"sign({row.velocity})", f"tanh({row.velocity}/{SMOOTHING})")
                for c, text in row.regressors.items()
            },
            known=row.known.replace(f"sign({row.velocity})", f"tanh({row.velocity}/{SMOOTHING})"),
        )
        for row in system.rows
    )
    if rows == system.rows:
        return system
    constants = {SMOOTHING: COULOMB_VELOCITY, **system.constants}
    return ParametricSystem(system.name, rows, system.inputs, constants)


def _fastest(system: ParametricSystem, values: dict[str, float]) -> float:
    """Fastest pole in 1/s of the model at rest."""
    p = np.array([values[name] for name in system.coefficients])
    c = np.array(list(system.constants.values()), dtype=np.float64)
    rest, still = np.zeros(len(system.states)), np.zeros(len(system.inputs))
    return fastest_pole(system, rest, still, p, c)


def _health() -> str:
    return ", ".join(f"{number} {word}" for number, word in enumerate(HEALTH))
