"""Export to FMU: the plant as FMUs of FMI 2.0 and 3.0, with C sources and a library."""

import hashlib
import io
import platform
import shutil
import subprocess
import sys
import tempfile
import uuid
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np

import flexid
from flexid.derivation.drive_source import plant_functions
from flexid.errors import SettingError
from flexid.exports.request import ExportRequest, doubts_of, rendered
from flexid.kernels.templates.run_status import BOUND
from flexid.models.flexible_joint import SMOOTHING, without_jumps
from flexid.recording.names import cut
from flexid.simulation.free_run import STEPS_PER_TIME_CONSTANT, fastest_pole

Causality = Literal["independent", "output", "input", "parameter"]


@dataclass(frozen=True)
class Variable:
    """Variable of an FMU."""

    name: str
    causality: Causality  # parameters can be changed between communication steps
    start: float | None  # None for time
    unit: str = ""
    description: str = ""


@dataclass(frozen=True, eq=False)
class Plant:
    """Plant for co-simulation."""

    description: str
    variables: tuple[Variable, ...]  # outputs, inputs, parameters, with value references from 1 on
    source: str = field(repr=False)  # text of plant.c

    def __post_init__(self) -> None:
        names = ["time", *(v.name for v in self.variables)]
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice is not None:
            raise SettingError(
                "fmu", f"already has a variable {twice!r}: rename the model's variable"
            )

    @cached_property
    def token(self) -> str:
        """GUID of the FMU, from its variables and source."""
        content = hashlib.sha256()
        for text in (repr(self.variables), self.source):
            content.update(text.encode() + b"\0")
        return f"{{{uuid.UUID(content.hexdigest()[:32])}}}"

    def count(self, causality: Causality) -> int:
        """Return the number of variables of a causality."""
        return sum(v.causality == causality for v in self.variables)


def plant_of(request: ExportRequest) -> Plant:
    """Return the plant of a model and its values."""
    system = without_jumps(request.system, request.joint)
    missing = [name for name in system.coefficients if name not in request.values]
    if missing:
        raise SettingError(
            "fmu",
            f"the plant needs values of {', '.join(missing)}: export an estimate with these values",
        )
    values = {name: float(request.values[name]) for name in system.coefficients}
    regressors = {name: text for row in system.rows for name, text in row.regressors.items()}
    named = (*system.inputs, *regressors, *system.constants)
    angles = dict.fromkeys(system.states[::2], "rad") | dict.fromkeys(system.states[1::2], "rad/s")
    units = {**dict.fromkeys(named, ""), **angles, **request.units}
    variables = (
        *(
            Variable(name, "output", 0.0, units[name], f"{what} of the {row.name}")
            for row in system.rows
            for name, what in ((row.coordinate, "position"), (row.velocity, "velocity"))
        ),
        *(Variable(name, "input", 0.0, units[name], "held over a step") for name in system.inputs),
        *(Variable(n, "parameter", values[n], units[n], text) for n, text in regressors.items()),
        *(Variable(n, "parameter", v, units[n]) for n, v in system.constants.items()),
    )
    rest, still = np.zeros(len(system.states)), np.zeros(len(system.inputs))
    constants = np.array(list(system.constants.values()), dtype=np.float64)
    fastest = fastest_pole(system, rest, still, np.array(list(values.values())), constants)
    text = rendered(
        "fmu/plant.c",
        system=system,
        steps_per_second=STEPS_PER_TIME_CONSTANT * fastest,
        bound=BOUND,
        variables=variables,
        functions=plant_functions(system),
    )
    return Plant(f"{system.name}: the plant, from its inputs to its states", variables, text)


VERSIONS = ("2.0", "3.0")

_COMPILERS = ("cc", "gcc", "clang")
_OPTIONS = ("-std=c99", "-O2", "-ffp-contract=off", "-fPIC", "-shared", "-fvisibility=hidden")
_SYSTEMS = {"linux": ("linux", ".so"), "darwin": ("darwin", ".dylib")}
_PROCESSORS = {"x86_64": "x86_64", "amd64": "x86_64", "aarch64": "aarch64", "arm64": "aarch64"}
_YEAR = (1980, 1, 1, 0, 0, 0)  # equal contents make equal files
_TIME = Variable("time", "independent", None, "s", "simulated time")


def write(request: ExportRequest, directory: Path) -> list[str]:
    """Write the plant as an FMU of each version; return warnings."""
    plant = plant_of(request)
    for version in VERSIONS:
        (directory / f"plant_fmi{version[0]}.fmu").write_bytes(packed(plant, version))
    return _warnings(request, plant)


def _warnings(request: ExportRequest, plant: Plant) -> list[str]:
    found = []
    if SMOOTHING in {v.name for v in plant.variables}:
        found.append(
            f"the plant's friction is smoothed over the parameter {SMOOTHING}: it creeps where the "
            f"drive sticks"
        )
    if request.identification is not None:
        found += doubts_of(request.identification.coefficients)
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
            "there is no C compiler here: the FMUs contain only sources, which importers compile"
        )
    return found


def packed(plant: Plant, version: str) -> bytes:
    """Return the contents of an FMU file."""
    compiled = (f"fmi{version[0]}.c", "plant.c")
    texts = {name: rendered(f"fmu/{name}") for name in (compiled[0], "fmi.h")}
    texts |= {"plant.c": plant.source, "plant.h": rendered("fmu/plant.h", plant=plant)}
    files = {f"sources/{name}": text.encode() for name, text in texts.items()}
    variables = (_TIME, *plant.variables)
    files["modelDescription.xml"] = rendered(
        "fmu/modelDescription.xml",
        plant=plant,
        version=version,
        flexid_version=flexid.__version__,
        sources=compiled,
        units=dict.fromkeys(v.unit for v in (*plant.variables, _TIME) if v.unit),
        variables=variables,
        outputs=[place for place, v in enumerate(variables) if v.causality == "output"],
    ).encode()
    if version == "3.0":
        files["sources/buildDescription.xml"] = rendered(
            "fmu/buildDescription.xml", sources=compiled
        ).encode()
    files |= _library(version, texts, compiled)
    with io.BytesIO() as file:
        with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
            for name in sorted(files):
                archive.writestr(zipfile.ZipInfo(name, _YEAR), files[name], zipfile.ZIP_DEFLATED)
        return file.getvalue()


def _library(version: str, texts: dict[str, str], compiled: Sequence[str]) -> dict[str, bytes]:
    """Return the compiled library by its path in the FMU; empty without a compiler."""
    compiler, place = _compiler(), _place(version)
    if compiler is None or place is None:
        return {}
    folder, suffix = place
    library = f"plant{suffix}"
    command = [compiler, *_OPTIONS, *compiled, "-o", library, "-lm"]
    try:
        with tempfile.TemporaryDirectory() as made:
            for name, text in texts.items():
                Path(made, name).write_text(text, encoding="utf-8")
            subprocess.run(
                command, cwd=made, capture_output=True, text=True, errors="replace", check=True
            )
            return {f"binaries/{folder}/{library}": Path(made, library).read_bytes()}
    except (OSError, subprocess.CalledProcessError) as error:
        output = " ".join((getattr(error, "stderr", "") or str(error)).split())
        raise SettingError(
            "fmu",
            f"{compiler} cannot compile it ({cut(output, 300)}): correct that, or export without a "
            f"compiler on the path to get only sources",
        ) from None


def _compiler() -> str | None:
    """Return the path of a C compiler, or None."""
    return next(filter(None, map(shutil.which, _COMPILERS)), None)


def _place(version: str) -> tuple[str, str] | None:
    """Return the library's folder and suffix for this platform, or None without them."""
    system = _SYSTEMS.get(sys.platform)
    processor = _PROCESSORS.get(platform.machine().lower())
    if system is None or processor is None:
        return None
    name, suffix = system
    if version == "3.0":
        return f"{processor}-{name}", suffix
    return (f"{name}64", suffix) if processor == "x86_64" else None
