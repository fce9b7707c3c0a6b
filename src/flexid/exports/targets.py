"""What can be exported: one entry per target of ``flexid export --to``."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal, NamedTuple

from flexid.errors import SettingError

if TYPE_CHECKING:
    from flexid.estimators.samples import Samples
    from flexid.exports.estimator import EstimatorSettings
    from flexid.exports.source import ExportSource


@dataclass(frozen=True, eq=False)
class ExportRequest:
    """What is to be exported.

    Parameters
    ----------
    source : ExportSource
        The model and what is known of it.
    settings : EstimatorSettings, optional
        Of the online estimator, for targets that have one.
    samples : Samples, optional
        Motion to test it with.
    """

    source: "ExportSource"
    settings: "EstimatorSettings | None" = None
    samples: "Samples | None" = None


Write = Callable[[ExportRequest, Path], Sequence[str]]
"""Writes the files of a target into an empty directory; returns what they do not hold."""


class Target(NamedTuple):
    """A kind of files.

    Parameters
    ----------
    summary : str
        What they are, for the help.
    load : callable
        Returns the function that writes them, which is imported only then.
    estimator : {"needed", "possible", "none"}
        Whether the settings of an online estimator belong to it.
    """

    summary: str
    load: Callable[[], Write]
    estimator: Literal["needed", "possible", "none"]


def _c99() -> Write:
    from flexid.exports.c99 import write_c99

    return write_c99


def _mjcf() -> Write:
    from flexid.exports.mjcf import write_mjcf

    return write_mjcf


def _fmu() -> Write:
    from flexid.exports.fmu import write_fmu

    return write_fmu


TARGETS = {
    "c99": Target("the online estimator in C99, for a drive", _c99, "needed"),
    "mjcf": Target("the joint as a MuJoCo scene", _mjcf, "none"),
    "fmu": Target("plant and online estimator for simulators, FMI 2.0 and 3.0", _fmu, "possible"),
}
"""By name."""


def export_to(target: str, request: ExportRequest, directory: Path) -> tuple[str, ...]:
    """Write the files of a target.

    Parameters
    ----------
    target : str
        One of `TARGETS`.
    request : ExportRequest
        What.
    directory : path
        An empty one.

    Returns
    -------
    tuple of str
        What the files have not, or otherwise than the estimate; a sentence each.

    Raises
    ------
    SettingError
        If the target has no use for a setting, or lacks one.
    """
    chosen = TARGETS[target]
    if request.settings is None and chosen.estimator == "needed":
        raise SettingError("sample-time", "is missing: give the seconds between samples, or a log")
    if request.settings is not None and chosen.estimator == "none":
        raise SettingError(target, "has no estimator: leave out the options of one")
    return tuple(chosen.load()(request, directory))
