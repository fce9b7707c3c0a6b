"""Equations of models, and files for other tools: `flexid.derive` and `flexid.export`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from importlib import import_module
from math import isfinite
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from flexid.errors import SettingError
from flexid.library.arguments import entrance, one_thread
from flexid.models.parametric_system import ParametricSystem

if TYPE_CHECKING:
    from flexid.estimators.samples import Samples
    from flexid.exports.request import EstimatorSettings, ExportRequest
    from flexid.library.arguments import FilePath
    from flexid.library.joint_estimate import JointEstimate
    from flexid.library.logs import Columns, OneLog


_SHIPPED = "flexible-joint"  # name of the model that needs no file


class ObserverText(str):
    """Equations as text, with notes on them."""

    notes: tuple[str, ...]

    def __new__(cls, text: str, notes: tuple[str, ...] = ()) -> ObserverText:
        """Create the text with its notes."""
        made = super().__new__(cls, text)
        made.notes = notes
        return made


@entrance
def derive(
    model: ParametricSystem | FilePath,
    *,
    to: Literal["latex", "python", "c"] = "latex",
    terms: Iterable[str] | None = None,
    unknown_input_gain: bool = False,
) -> ObserverText:
    """Derive a model's observer as LaTeX, Python or C.

    The observer estimates the model's coefficients while the machine runs (Huang, 2003).

    Parameters
    ----------
    model : ParametricSystem or path
        A TOML model file, or flexible-joint. Or a `ParametricSystem`.
    to : {"latex", "python", "c"}, optional
        Format of the equations.
    terms : iterable of str, optional
        Terms of flexible-joint; by default the terms of the paper.
    unknown_input_gain : bool, optional
        Estimate beta1 of flexible-joint as well.

    Returns
    -------
    str
        The equations as LaTeX, a Python module, or a C99 file. Its `notes` name what is integrated
        numerically, and the inputs whose rate of change the observer needs.
    """
    from flexid.paper.observer import derive_observer
    from flexid.paper.printing import c_observer, latex_observer, python_observer

    printers = {"latex": latex_observer, "python": python_observer, "c": c_observer}
    observer = derive_observer(declared(model, terms, unknown_input_gain))
    notes = []
    if observer.quadratures:
        notes.append(
            f"no plain closed form for the immersion of {', '.join(observer.quadratures)}; "
            f"integrated numerically"
        )
    if observer.input_rates:
        rates = ", ".join(map(str, observer.input_rates))
        notes.append(
            f"the observer needs the input's rate of change: {rates}; least squares (flexid "
            f"identify) does not"
        )
    return ObserverText(printers[to](observer), tuple(notes))


def declared(model: Any, terms: Iterable[str] | None, unknown_input_gain: bool) -> ParametricSystem:
    """Return the model: flexible-joint, the given system, or the model of a file."""
    if isinstance(model, str) and model == _SHIPPED:
        from flexid.models.flexible_joint import PAPER_TERMS, flexible_joint

        # The equations hold for every value of a known beta1, which stays a symbol in them.
        known = None if unknown_input_gain else {"beta1": 1.0}
        return flexible_joint(PAPER_TERMS if terms is None else tuple(terms), known=known)
    if terms is not None or unknown_input_gain:
        raise SettingError(
            "unknown_input_gain" if terms is None else "terms",
            f"is for {_SHIPPED}; other models define their own terms",
        )
    if isinstance(model, ParametricSystem):
        return model
    from flexid.models.model_file import read_model

    return read_model(Path(model))


class ExportedFiles(NamedTuple):
    """Files written by `flexid.export`, and warnings on what they leave out."""

    paths: tuple[Path, ...]
    warnings: tuple[str, ...]  # a sentence each


@entrance
@one_thread()
def export(
    what: JointEstimate | ParametricSystem | FilePath,
    *,
    to: Literal["c99", "mjcf", "fmu"],
    out: FilePath,
    sample_time: float | None = None,
    hold: Literal["zero", "linear"] | None = None,
    filter_rate: float | None = None,
    memory: float | None = None,
    log: OneLog | None = None,
    columns: Columns | None = None,
    terms: Iterable[str] | None = None,
) -> ExportedFiles:
    """Write an estimate or a model as code or files for another tool.

    c99 is the online estimator as one header and one source in C, with an example and a test
    vector. mjcf is the joint or arm of an estimate as a scene for MuJoCo; a warning names what
    MuJoCo cannot represent. fmu is the plant of an estimate as FMUs for co-simulation, with their
    sources, and compiled if a C compiler is found.

    Parameters
    ----------
    what : JointEstimate, ParametricSystem or path
        An estimate.json or its folder, a TOML model file, or flexible-joint. Or a
        result of `flexid.identify`, or a `ParametricSystem`.
    to : {"c99", "mjcf", "fmu"}
        The online estimator in C99, a scene of MuJoCo, or the plant as FMUs of FMI 2.0 and 3.0.
    out : path
        Directory for the files.
    sample_time : float, optional
        Seconds between the estimator's samples; by default the sample time of the log.
    hold : {"zero", "linear"}, optional
        The input between samples: held, or on straight lines. By default as identified, else zero.
    filter_rate : float, optional
        Rate in 1/s of the filter for positions; by default as identified, else 20.
    memory : float, optional
        Seconds after which a sample counts 1/e as much, or inf; by default 60.
    log : log, optional
        Log whose motion is used for the test vector. As `flexid.read_log` takes it.
    columns : path or mapping, optional
        A column map for the log. As `flexid.identify` takes it.
    terms : iterable of str, optional
        Terms of flexible-joint; by default the terms of the paper.
    """
    from flexid.files import output_directory

    settings = {"hold": hold, "filter_rate": filter_rate, "memory": memory}
    given = {name: value for name, value in settings.items() if value is not None}
    of_estimator = [n for n, v in (("sample_time", sample_time), ("log", log)) if v is not None]
    if to != "c99" and (of_estimator or given):
        option = [*given, *of_estimator][0]
        raise SettingError(option, f"is for the online estimator of c99: leave it out with {to}")
    module, content = _exporter(what, terms, to)
    of_c99: list[Any] = []
    if to == "c99":
        samples = None if log is None else _longest(log, columns, content)
        of_c99 = [_estimator_settings(content, samples, sample_time, given), samples]
    with output_directory(Path(out)) as directory:
        warnings = import_module(f"flexid.exports.{module}").write(content, directory, *of_c99)
        names = sorted(path.name for path in directory.iterdir())
    return ExportedFiles(tuple(Path(out) / name for name in names), tuple(warnings))


def _exporter(what: Any, terms: Iterable[str] | None, to: str) -> tuple[str, Any]:
    """Return the name of the exporting module, and its input: an estimate or an export request."""
    from flexid.exports.request import ExportRequest, request_of_identification
    from flexid.library.identify import estimated
    from flexid.library.joint_estimate import JointEstimate

    path = Path(what) if isinstance(what, str | PathLike) and what != _SHIPPED else None
    stored = path is not None and (path.suffix.lower() == ".json" or path.is_dir())
    if isinstance(what, JointEstimate) or stored:
        if terms is not None:
            raise SettingError("terms", f"is for {_SHIPPED}; an estimate has its own terms")
        found = estimated(what).result
        if found.model == "arm":
            if to == "mjcf":
                return "mjcf_arm", found
            reason = "is for one joint, and the estimate is of an arm: export it to mjcf"
            raise SettingError(to, reason)
        return to, found if to == "mjcf" else request_of_identification(found)
    model = declared(what, terms, unknown_input_gain=what == _SHIPPED)
    if to == "mjcf":
        raise SettingError(to, "needs values: give an estimate.json of flexid identify")
    return to, ExportRequest(model)


def _estimator_settings(
    request: ExportRequest,
    samples: Samples | None,
    sample_time: float | None,
    given: Mapping[str, Any],
) -> EstimatorSettings:
    """Return the settings of the estimator: as given, else as identified."""
    from flexid.exports.request import EstimatorSettings

    of_log = None if samples is None else samples.sample_time
    h = of_log if sample_time is None else sample_time
    if h is None:
        raise SettingError("sample_time", "is missing: give the seconds between samples, or a log")
    if of_log is not None and abs(h - of_log) > 1e-6 * of_log:
        raise SettingError(
            "sample_time", f"is {h:g} s and the log's is {of_log:g} s: leave one out"
        )
    found: dict[str, Any] = {}
    if request.identification is not None:
        choices = request.identification.choices
        found["hold"] = "zero" if choices.hold == "zero" else "linear"
        if choices.filter_rate is not None and isfinite(choices.filter_rate):
            found["filter_rate"] = choices.filter_rate
    return EstimatorSettings(h, **(found | dict(given)))


def _longest(log: Any, columns: Any, request: ExportRequest) -> Samples:
    """Return samples of a log's longest recording; raise if its input has another unit."""
    from flexid.estimators.samples import samples_of_recording
    from flexid.library.logs import read_log, samples

    read = read_log(log, columns=columns)
    if request.identification is None:
        return max(samples(read), key=len)
    unit, kind = read.recordings[0].input_unit, request.identification.model
    if kind != "link":
        (known,) = {request.units[name] for name in request.system.inputs}
        if unit != known:
            found = f"an input in {unit}" if unit else "no input"
            raise SettingError(
                "log",
                f"has {found}, and the estimate was made with one in {known}: give a log of the "
                f"same input",
            )
    return max((samples_of_recording(part, kind) for part in read.recordings), key=len)
