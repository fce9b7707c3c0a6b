"""What can be exported: one entry per target of ``flexid export --to``."""

from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Literal, NamedTuple

from flexid.errors import SettingError

if TYPE_CHECKING:
    from flexid.arms.result import ArmIdentification
    from flexid.estimators.samples import Samples
    from flexid.exports.estimator import EstimatorSettings
    from flexid.exports.source import ExportSource


@dataclass(frozen=True, eq=False)
class ExportRequest:
    """What is to be exported."""

    source: "ExportSource"
    settings: "EstimatorSettings | None" = None  # of the online estimator
    samples: "Samples | None" = None  # motion to test it with


class Target(NamedTuple):
    """A kind of files."""

    summary: str  # for the help
    # whether the settings of an online estimator belong to it
    estimator: Literal["needed", "possible", "none"]
    with_memory: bool = False  # it holds friction that remembers its path


TARGETS = {
    "c99": Target("the online estimator in C99, for a drive", "needed"),
    "mjcf": Target("the joint or arm as a MuJoCo scene", "none", with_memory=True),
    "fmu": Target("plant and online estimator for simulators, FMI 2.0 and 3.0", "possible"),
}
"""By name, which is that of a module here."""


def export_to(target: str, request: ExportRequest, directory: Path) -> tuple[str, ...]:
    """Write the files of a target into an empty directory; return what they do not hold."""
    chosen = TARGETS[target]
    if request.settings is None and chosen.estimator == "needed":
        raise SettingError("sample-time", "is missing: give the seconds between samples, or a log")
    if request.settings is not None and chosen.estimator == "none":
        raise SettingError(target, "has no estimator: leave out the options of one")
    module = import_module(f"flexid.exports.{target}")
    return tuple(vars(module)[f"write_{target}"](request, directory))


def export_arm(target: str, arm: "ArmIdentification", directory: Path) -> tuple[str, ...]:
    """Write the files of a target for an arm; return what they do not hold."""
    if target != "mjcf":
        raise SettingError(
            target, "is for one joint, and the estimate is of an arm: export it to mjcf"
        )
    from flexid.exports.mjcf_arm import write_arm

    return write_arm(arm, directory)
