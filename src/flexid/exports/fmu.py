"""The target ``fmu``: plant and estimator for simulators, as FMUs of FMI 2.0 and 3.0.

An FMU has its C sources inside, so that any importer with a compiler can use it; where there is a
compiler here, it holds a library for this machine as well.
"""

import io
import platform
import shutil
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING

import flexid
from flexid.errors import SettingError
from flexid.exports.fmu_model import FmuModel, Variable, estimator_model, plant_model
from flexid.exports.request import rendered
from flexid.models.terms import SMOOTHING
from flexid.recording.names import cut

if TYPE_CHECKING:
    from flexid.exports.request import ExportRequest, ExportSource

VERSIONS = ("2.0", "3.0")

_COMPILERS = ("cc", "gcc", "clang")
_OPTIONS = ("-std=c99", "-O2", "-ffp-contract=off", "-fPIC", "-shared", "-fvisibility=hidden")
_SYSTEMS = {"linux": ("linux", ".so"), "darwin": ("darwin", ".dylib")}
_PROCESSORS = {"x86_64": "x86_64", "amd64": "x86_64", "aarch64": "aarch64", "arm64": "aarch64"}
_YEAR = (1980, 1, 1, 0, 0, 0)  # the same content is the same file
_TIME = Variable("time", "independent", None, "s", "simulated time")


def write_fmu(request: "ExportRequest", directory: Path) -> list[str]:
    """Write the FMUs of a plant, of an estimator, or of both."""
    models: list[FmuModel] = []
    source = request.source
    whole = bool(source.values) and source.values.keys() >= {*source.system.coefficients}
    if whole or request.settings is None:
        models.append(plant_model(source))
    if request.settings is not None:
        models.append(estimator_model(source, request.settings))
    for model in models:
        for version in VERSIONS:
            name = f"{model.identifier}_fmi{version[0]}.fmu"
            (directory / name).write_bytes(packed(model, version))
    return _warnings(source, models)


def _warnings(source: "ExportSource", models: list[FmuModel]) -> list[str]:
    """What the FMUs have not, or otherwise than the estimate."""
    found = []
    names = {v.name for model in models if model.identifier == "plant" for v in model.variables}
    if SMOOTHING in names:
        found.append(
            f"the plant's friction changes its sign over {SMOOTHING}, a parameter in rad/s: it "
            f"creeps where the drive sticks"
        )
    missing = [name for name in source.system.coefficients if name not in source.values]
    if source.values and missing:
        found.append(f"the plant is left out: the log does not determine {', '.join(missing)}")
    if source.identification is not None and names:
        found += source.doubts
        alignment = source.identification.choices.alignment
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
    variables = [(_TIME, 0), *((v, model.reference(v)) for v in model.variables)]
    places = [(v, place, number) for place, (v, number) in enumerate(variables, 1)]
    outputs = [(place, number) for v, place, number in places if v.causality == "output"]
    computed = [(place, number) for v, place, number in places if v.initial == "calculated"]
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
            _compile(command, made)
            return {f"binaries/{folder}/{library}": Path(made, library).read_bytes()}
    except OSError as error:
        where = f" of {error.filename}" if error.filename else ""
        raise SettingError(
            "fmu",
            f"its library cannot be made in a temporary folder ({error.strerror}{where}): make "
            f"room there, or set TMPDIR to another folder",
        ) from None


def _compile(command: list[str], folder: str) -> None:
    """Run a compiler, or raise with its message."""
    try:
        done = subprocess.run(
            command, cwd=folder, capture_output=True, text=True, errors="replace", check=False
        )
    except OSError as error:
        raise SettingError(
            "fmu", f"{command[0]} cannot be run ({error.strerror}): check its installation"
        ) from None
    if done.returncode:
        raise _failed(command[0], done)


def _failed(compiler: str, done: "subprocess.CompletedProcess[str]") -> SettingError:
    """The error of a compiler that failed or was ended."""
    hide = "export without a compiler on the path to get only sources"
    if done.returncode < 0:
        return SettingError(
            "fmu",
            f"{compiler} was ended by signal {-done.returncode} before the library was made: give "
            f"it more memory, or {hide}",
        )
    lines = [line.strip() for line in done.stderr.splitlines() if line.strip()]
    said = next((line for line in lines if "error" in line.lower()), (lines or ["nothing"])[-1])
    return SettingError(
        "fmu",
        f"{compiler} ended with status {done.returncode}, {cut(said, 200)!r}: correct that, or "
        f"{hide}",
    )


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
