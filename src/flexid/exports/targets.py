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
    """What is to be exported."""

    source: "ExportSource"
    settings: "EstimatorSettings | None" = None  # of the online estimator
    samples: "Samples | None" = None  # motion to test it with


Write = Callable[[ExportRequest, Path], Sequence[str]]
"""Writes the files of a target into an empty directory; returns what they do not hold."""


class Target(NamedTuple):
    """A kind of files."""

    summary: str  # for the help
    load: Callable[[], Write]  # imports the function that writes the files
    # whether the settings of an online estimator belong to it
    estimator: Literal["needed", "possible", "none"]
    with_memory: bool = False  # it holds friction that remembers its path


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
    "mjcf": Target("the joint as a MuJoCo scene", _mjcf, "none", with_memory=True),
    "fmu": Target("plant and online estimator for simulators, FMI 2.0 and 3.0", _fmu, "possible"),
}
"""By name."""


def export_to(target: str, request: ExportRequest, directory: Path) -> tuple[str, ...]:
    """Write the files of a target."""
    chosen = TARGETS[target]
    if request.settings is None and chosen.estimator == "needed":
        raise SettingError("sample-time", "is missing: give the seconds between samples, or a log")
    if request.settings is not None and chosen.estimator == "none":
        raise SettingError(target, "has no estimator: leave out the options of one")
    return tuple(chosen.load()(request, directory))
