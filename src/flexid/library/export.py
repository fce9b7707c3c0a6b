"""Estimates and models as code and files for other tools: `flexid.export`."""

from collections.abc import Iterable, Mapping
from functools import partial
from math import isfinite
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from flexid.errors import ArgumentError, SettingError, did_you_mean
from flexid.library.derive import SHIPPED, declared
from flexid.library.entrance import as_path, entrance, in_one_thread, kind_of
from flexid.library.estimates import estimated, identified
from flexid.models.parametric_system import ParametricSystem

if TYPE_CHECKING:
    from flexid.arms.result import ArmIdentification
    from flexid.estimators.samples import Samples
    from flexid.exports.estimator import EstimatorSettings
    from flexid.exports.source import ExportSource
    from flexid.library.joint_estimate import JointEstimate
    from flexid.library.logs import Columns, OneLog


class ExportedFiles(NamedTuple):
    """What `flexid.export` has written.

    Parameters
    ----------
    paths : tuple of Path
        The files.
    warnings : tuple of str
        What they do not hold of the estimate, or hold otherwise; a sentence each.
    """

    paths: tuple[Path, ...]
    warnings: tuple[str, ...]


@entrance
@in_one_thread
def export(
    what: "JointEstimate | ParametricSystem | str | PathLike[str]",
    *,
    to: Literal["c99", "mjcf", "fmu"],
    out: "str | PathLike[str]",
    sample_time: float | None = None,
    hold: Literal["zero", "linear"] | None = None,
    velocities: bool = False,
    gain: Mapping[str, float] | None = None,
    filter_rate: float | None = None,
    memory: float | None = None,
    log: "OneLog | None" = None,
    columns: "Columns | None" = None,
    terms: Iterable[str] | None = None,
) -> ExportedFiles:
    """Write an estimate or a model as code or files for another tool.

    c99 is the online estimator as one header and one source in C, with an example and a test
    vector. mjcf is the joint or arm of an estimate as a scene for MuJoCo; what MuJoCo has no word
    for is left out, with a warning. fmu is the plant of an estimate and, with a sample time, the
    online estimator as FMUs for co-simulation, with sources and, where there is a compiler,
    compiled.

    Parameters
    ----------
    what : JointEstimate, ParametricSystem or path
        An estimate.json or the folder that holds it, a TOML model file, or flexible-joint. Or what
        `flexid.identify` returned, or a `ParametricSystem`.
    to : {"c99", "mjcf", "fmu"}
        The online estimator in C99, a scene of MuJoCo, or FMUs of FMI 2.0 and 3.0.
    out : path
        Directory for the files.
    sample_time : float, optional
        Seconds between the estimator's samples; the log's if there is one.
    hold : {"zero", "linear"}, optional
        The input between samples; as it was identified, else zero.
    velocities : bool, optional
        Take measured velocities, too.
    gain : mapping of str to float, optional
        Constant gains by row or coefficient, the paper's observer, which needs velocities; least
        squares if not given.
    filter_rate : float, optional
        Rate in 1/s of the filter that positions pass; as it was identified, else 20.
    memory : float, optional
        Seconds after which a sample counts 1/e as much, or inf; 60 if not given.
    log : log, optional
        Motion for the test vector. As `flexid.read_log` takes it.
    columns : path or mapping, optional
        A column map for the log. As `flexid.identify` takes it.
    terms : iterable of str, optional
        Terms of flexible-joint; those of the paper if not given.

    Returns
    -------
    ExportedFiles
        Their paths, and what they do not hold.

    Raises
    ------
    SettingError
        If the estimate cannot be read, or an option does not suit.
    ModelError
        If the model file cannot be used.
    RecordingError
        If the log cannot be used.
    ArgumentError
        If an option is unknown or of a wrong type.
    """
    from flexid.exports.targets import TARGETS, ExportRequest, export_arm, export_to
    from flexid.report.documents import output_directory

    if to not in TARGETS:
        raise SettingError("to", f"{to!r} is unknown{did_you_mean(str(to), TARGETS)}")
    given: dict[str, Any] = {
        "hold": hold,
        "gains": gain,
        "filter_rate": filter_rate,
        "memory_time": memory,
        "velocities": velocities or None,
    }
    given = {name: value for name, value in given.items() if value is not None}
    arm = _arm_of(what)
    if arm is None:
        source = export_source(what, terms, with_memory=TARGETS[to].with_memory)
        samples = None if log is None else _longest(log, columns, source)
        settings = estimator_settings(source, samples, sample_time, given)
        write = partial(export_to, to, ExportRequest(source, settings, samples))
    else:
        options = (*given.values(), sample_time, terms, log)
        if to == "mjcf" and any(option is not None for option in options):
            raise SettingError(to, "of an arm takes no options but --out: leave the others out")
        write = partial(export_arm, to, arm)
    with output_directory(as_path("export", "out", out)) as directory:
        warnings = write(directory)
        names = sorted(path.name for path in directory.iterdir())
    return ExportedFiles(tuple(Path(out) / name for name in names), warnings)


def _arm_of(what: Any) -> "ArmIdentification | None":
    """The arm whose stored estimate is meant."""
    if not _is_estimate(what):
        return None
    stored, _ = estimated("export", "what", what)
    return stored if stored.model == "arm" else None


def _is_estimate(what: Any) -> bool:
    is_path = isinstance(what, str | PathLike) and what != SHIPPED
    return is_path and _names_an_estimate(as_path("export", "what", what))


def export_source(
    what: Any, terms: Iterable[str] | None = None, *, with_memory: bool = False
) -> "ExportSource":
    """The model that is meant, with what is known of it."""
    from flexid.exports.source import ExportSource, source_of_identification
    from flexid.library.joint_estimate import JointEstimate

    if isinstance(what, JointEstimate):
        return source_of_identification(what.result, with_memory=with_memory)
    is_path = isinstance(what, str | PathLike) and what != SHIPPED
    if _is_estimate(what):
        stored, _ = identified("export", "what", what)
        return source_of_identification(stored, with_memory=with_memory)
    if not is_path and what != SHIPPED and not isinstance(what, ParametricSystem):
        raise ArgumentError(
            "export",
            "what",
            f"is {kind_of(what)}: give an estimate, a model, or the path of one",
        )
    return ExportSource(declared(what, terms, unknown_input_gain=what == SHIPPED))


def _names_an_estimate(path: Path) -> bool:
    """Whether a path is that of an estimate, or of a folder, which may hold one."""
    return path.suffix.lower() == ".json" or path.is_dir()


def estimator_settings(
    source: "ExportSource",
    samples: "Samples | None",
    sample_time: float | None,
    given: Mapping[str, Any],
) -> "EstimatorSettings | None":
    """Settings of the estimator: what is given, else as identified; None if none is meant."""
    from flexid.exports.estimator import EstimatorSettings

    if sample_time is None and samples is None:
        if given:
            raise SettingError(
                "sample-time", "is missing: give the seconds between samples, or a log"
            )
        return None
    if sample_time is None or samples is None:
        h = samples.sample_time if sample_time is None else sample_time  # type: ignore[union-attr]
    elif abs(sample_time - samples.sample_time) > 1e-6 * samples.sample_time:
        raise SettingError(
            "sample-time",
            f"is {sample_time:g} s and the log's is {samples.sample_time:g} s: leave one out",
        )
    else:
        h = sample_time
    found: dict[str, Any] = {}
    if source.identification is not None:
        choices = source.identification.choices
        found["hold"] = "zero" if choices.hold == "zero" else "linear"
        if choices.filter_rate is not None and isfinite(choices.filter_rate):
            found["filter_rate"] = choices.filter_rate
    return EstimatorSettings(h, start=source.values, **(found | dict(given)))


def _longest(log: Any, columns: Any, source: "ExportSource") -> "Samples":
    """Samples of a log's longest recording; raise if its input is not the estimate's."""
    from flexid.library.logs import one_log, samples

    read = one_log("export", log, columns)
    unit = read.recordings[0].input_unit
    if source.identification is not None and source.identification.model != "link":
        (known,) = {source.units[name] for name in source.system.inputs}
        if unit != known:
            raise SettingError(
                "log",
                f"has an input in {unit or 'no unit'}, and the estimate was made with one in "
                f"{known}: give a log of the same input",
            )
    return max(samples(read), key=len)
