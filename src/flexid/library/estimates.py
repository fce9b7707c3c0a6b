"""Estimates from what a user gives: what `flexid.identify` returned, files, or their content."""

from collections.abc import Callable, Mapping
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexid.errors import ArgumentError
from flexid.library.entrance import as_path, kind_of

if TYPE_CHECKING:
    from flexid.arms.result import ArmIdentification
    from flexid.identification.result.identification import Identification
    from flexid.stored_estimates.estimate_file import EstimateFile


def estimate_content(function: str, argument: str, estimate: Any) -> Path | Mapping[str, Any]:
    """A file, or the content of one; an `ArgumentError` for what holds no estimate."""
    from flexid.library.joint_estimate import JointEstimate

    if isinstance(estimate, JointEstimate):
        return estimate.document
    if isinstance(estimate, Mapping):
        return estimate
    if isinstance(estimate, str | PathLike):
        return as_path(function, argument, estimate)
    raise ArgumentError(
        function,
        argument,
        f"is {kind_of(estimate)}: give what flexid.identify returned, or the path of an "
        f"estimate.json",
    )


def identified(function: str, argument: str, estimate: Any) -> "tuple[Identification, str]":
    """The identification of one joint that is meant, and its file, if it is from one."""
    from flexid.stored_estimates.estimate_file import stored_identification

    return _read(function, argument, estimate, stored_identification)


def estimated(
    function: str, argument: str, estimate: Any
) -> "tuple[Identification | ArmIdentification, str]":
    """The same, of one joint or an arm."""
    from flexid.stored_estimates.estimate_file import stored_estimate

    return _read(function, argument, estimate, stored_estimate)


def _read(
    function: str, argument: str, estimate: Any, stored: "Callable[[EstimateFile], Any]"
) -> tuple[Any, str]:
    from flexid.library.joint_estimate import JointEstimate
    from flexid.stored_estimates.estimate_file import read_estimate

    if isinstance(estimate, JointEstimate):
        return estimate.result, ""
    content = estimate_content(function, argument, estimate)
    file = read_estimate(content)
    return stored(file), "" if isinstance(content, Mapping) else file.name
