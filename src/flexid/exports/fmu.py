"""The target ``fmu``: plant and estimator for simulators, as FMUs of FMI 2.0 and 3.0.

An FMU has its C sources inside, so that any importer with a compiler can use it; where there is a
compiler here, it holds a library for this machine as well.
"""

import hashlib
import io
import platform
import shutil
import subprocess
import sys
import tempfile
import uuid
import zipfile
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np

import flexid
from flexid.derivation.drive_source import plant_functions
from flexid.errors import SettingError
from flexid.exports.c99 import DriveSource
from flexid.exports.request import ExportRequest, rendered
from flexid.kernels.templates.run_status import BOUND
from flexid.models.parametric_system import ParametricSystem
from flexid.models.terms import SMOOTHING, without_jumps
from flexid.recording.names import cut
from flexid.simulation.sampled import STEPS_PER_TIME_CONSTANT, fastest_pole

_FIRST_INTEGER = 1001  # value reference of the first integer output

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

    @cached_property
    def reals(self) -> list[Variable]:
        """Those that are no integers."""
        return [v for v in self.variables if not v.integer]

    @cached_property
    def references(self) -> dict[str, int]:
        """Value reference of each variable: reals are counted from 1, and 0 is the time."""
        integers = [v.name for v in self.variables if v.integer]
        return {
            "time": 0,
            **{v.name: number for number, v in enumerate(self.reals, 1)},
            **{name: number for number, name in enumerate(integers, _FIRST_INTEGER)},
        }

    @cached_property
    def token(self) -> str:
        """What an importer has to name: it changes with everything that the FMU does."""
        content = hashlib.sha256()
        for text in (repr(self.variables), repr(self.step), *self.sources.values()):
            content.update(text.encode() + b"\0")
        return f"{{{uuid.UUID(content.hexdigest()[:32])}}}"

    def count(self, causality: Causality) -> int:
        """Number of reals of a causality."""
        return sum(v.causality == causality for v in self.reals)

    def header(self) -> str:
        """Text of ``model.h``."""
        return rendered("fmu/model.h", model=self, first_integer=_FIRST_INTEGER)


def plant_model(request: ExportRequest) -> FmuModel:
    """The model with its values, as a plant."""
    system = without_jumps(request.system)
    missing = [name for name in system.coefficients if name not in request.values]
    if missing:
        raise SettingError(
            "fmu",
            f"the plant needs values of {', '.join(missing)}: export an estimate, or add "
            f"--sample-time for the online estimator",
        )
    values = {name: float(request.values[name]) for name in system.coefficients}
    regressors = {name: text for row in system.rows for name, text in row.regressors.items()}
    named = (*system.inputs, *regressors, *system.constants)
    units = {**dict.fromkeys(named, ""), **request.units}
    variables = (
        *(
            Variable(name, "output", 0.0, unit, f"{what} of the {row.name}")
            for row in system.rows
            for name, unit, what in (
                (row.coordinate, "rad", "position"),
                (row.velocity, "rad/s", "velocity"),
            )
        ),
        *(Variable(name, "input", 0.0, units[name], "held over a step") for name in system.inputs),
        *(Variable(n, "parameter", values[n], units[n], text) for n, text in regressors.items()),
        *(Variable(n, "parameter", v, units[n]) for n, v in system.constants.items()),
    )
    text = rendered(
        "fmu/plant.c",
        system=system,
        steps_per_second=STEPS_PER_TIME_CONSTANT * _fastest(system, values),
        bound=BOUND,
        variables=variables,
        functions=plant_functions(system),
    )
    title = f"{system.name}: the plant, from its inputs to its states"
    return FmuModel("plant", title, variables, {"plant.c": text}, (), "", 1e-3, False)


def estimator_model(request: ExportRequest) -> FmuModel:
    """The online estimator of ``--to c99``, one sample for each communication step."""
    drive = DriveSource(request)
    settings = drive.settings
    states = drive.system.states
    units = {**request.units, **dict.fromkeys(states[::2], "rad")}
    units |= dict.fromkeys(states[1::2], "rad/s")
    health = ", ".join(f"{number} {word}" for number, word in enumerate(HEALTH))
    variables = (
        *(
            Variable(f"{name}_hat", "output", None, units.get(name, ""), "estimate")
            for name in drive.system.coefficients
        ),
        *(Variable(n, "input", 0.0, units.get(n, ""), "sample") for n in drive.sample_names),
        Variable("health", "output", None, "", health, integer=True),
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


def _fastest(system: ParametricSystem, values: dict[str, float]) -> float:
    """Fastest pole in 1/s of the model at rest."""
    p = np.array([values[name] for name in system.coefficients])
    c = np.array(list(system.constants.values()), dtype=np.float64)
    rest, still = np.zeros(len(system.states)), np.zeros(len(system.inputs))
    return fastest_pole(system, rest, still, p, c)


VERSIONS = ("2.0", "3.0")

_COMPILERS = ("cc", "gcc", "clang")
_OPTIONS = ("-std=c99", "-O2", "-ffp-contract=off", "-fPIC", "-shared", "-fvisibility=hidden")
_SYSTEMS = {"linux": ("linux", ".so"), "darwin": ("darwin", ".dylib")}
_PROCESSORS = {"x86_64": "x86_64", "amd64": "x86_64", "aarch64": "aarch64", "arm64": "aarch64"}
_YEAR = (1980, 1, 1, 0, 0, 0)  # the same content is the same file
_TIME = Variable("time", "independent", None, "s", "simulated time")


def write_fmu(request: ExportRequest, directory: Path) -> list[str]:
    """Write the FMUs of a plant, of an estimator, or of both."""
    models: list[FmuModel] = []
    whole = bool(request.values) and request.values.keys() >= {*request.system.coefficients}
    if whole or request.settings is None:
        models.append(plant_model(request))
    if request.settings is not None:
        models.append(estimator_model(request))
    for model in models:
        for version in VERSIONS:
            name = f"{model.identifier}_fmi{version[0]}.fmu"
            (directory / name).write_bytes(packed(model, version))
    return _warnings(request, models)


def _warnings(request: ExportRequest, models: list[FmuModel]) -> list[str]:
    """What the FMUs have not, or otherwise than the estimate."""
    found = []
    names = {v.name for model in models if model.identifier == "plant" for v in model.variables}
    if SMOOTHING in names:
        found.append(
            f"the plant's friction changes its sign over {SMOOTHING}, a parameter in rad/s: it "
            f"creeps where the drive sticks"
        )
    missing = [name for name in request.system.coefficients if name not in request.values]
    if request.values and missing:
        found.append(f"the plant is left out: the log does not determine {', '.join(missing)}")
    if request.identification is not None and names:
        found += request.doubts
        alignment = request.identification.choices.alignment
        late = {"input": alignment.input_delay.value, "link's encoder": alignment.link_delay.value}
        found += [
            f"the plant leaves out the delay of the {name}, {1e3 * delay:.3g} ms: shift that "
            f"signal outside"
            for name, delay in late.items()
            if delay
        ]
    if _compiler() is None or _place("3.0") is None:
        found.append(
            "there is no C compiler here: the FMUs hold only sources, which importers compile"
        )
    return found


def packed(model: FmuModel, version: str) -> bytes:
    """An FMU as bytes."""
    interface = (f"fmi{version[0]}.c", "fmi.h")
    texts = {**model.sources, "model.h": model.header()}
    texts |= {name: rendered(f"fmu/{name}") for name in interface}
    files = {f"sources/{name}": text.encode() for name, text in texts.items()}
    files["modelDescription.xml"] = _model_description(model, version)
    if version == "3.0":
        files["sources/buildDescription.xml"] = rendered(
            "fmu/buildDescription.xml", model=model, sources=_sources(model, "3.0")
        ).encode()
    files |= _library(model, version, texts)
    with io.BytesIO() as file:
        with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
            for name in sorted(files):
                archive.writestr(zipfile.ZipInfo(name, _YEAR), files[name], zipfile.ZIP_DEFLATED)
        return file.getvalue()


def _model_description(model: FmuModel, version: str) -> bytes:
    """The description of an FMU for co-simulation."""
    variables = [(v, model.references[v.name]) for v in (_TIME, *model.variables)]
    places = [(v, place, number) for place, (v, number) in enumerate(variables, 1)]
    outputs = [(place, number) for v, place, number in places if v.causality == "output"]
    computed = [(p, number) for v, p, number in places if v.start is None and v is not _TIME]
    return rendered(
        "fmu/modelDescription.xml",
        model=model,
        version=version,
        flexid_version=flexid.__version__,
        sources=_sources(model, version),
        units=dict.fromkeys(v.unit for v in (*model.variables, _TIME) if v.unit),
        variables=variables,
        outputs=outputs,
        computed=computed,
    ).encode()


def _sources(model: FmuModel, version: str) -> tuple[str, ...]:
    """Names of the files that are to be compiled."""
    own = (name for name in model.sources if name.endswith(".c"))
    return (f"fmi{version[0]}.c", *own)


def _library(model: FmuModel, version: str, texts: dict[str, str]) -> dict[str, bytes]:
    """The compiled library, by its path in the FMU; nothing where none can be made."""
    compiler, place = _compiler(), _place(version)
    if compiler is None or place is None:
        return {}
    folder, suffix = place
    library = f"{model.identifier}{suffix}"
    command = [compiler, *_OPTIONS, *_sources(model, version), "-o", library, "-lm"]
    try:
        with tempfile.TemporaryDirectory() as made:
            for name, text in texts.items():
                Path(made, name).write_text(text, encoding="utf-8")
            subprocess.run(
                command, cwd=made, capture_output=True, text=True, errors="replace", check=True
            )
            return {f"binaries/{folder}/{library}": Path(made, library).read_bytes()}
    except (OSError, subprocess.CalledProcessError) as error:
        said = " ".join((getattr(error, "stderr", "") or str(error)).split())
        raise SettingError(
            "fmu",
            f"{compiler} makes no library of it ({cut(said, 300)}): correct that, or export "
            f"without a compiler on the path to get only sources",
        ) from None


def _compiler() -> str | None:
    """A C compiler of this machine."""
    return next(filter(None, map(shutil.which, _COMPILERS)), None)


def _place(version: str) -> tuple[str, str] | None:
    """Folder of this machine's library and its suffix; None where the standard names none."""
    system = _SYSTEMS.get(sys.platform)
    processor = _PROCESSORS.get(platform.machine().lower())
    if system is None or processor is None:
        return None
    name, suffix = system
    if version == "3.0":
        return f"{processor}-{name}", suffix
    return (f"{name}64", suffix) if processor == "x86_64" else None
