"""Drive files: a `Drive` written down in TOML, and what an earlier identification knows better."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite, pi
from pathlib import Path
from typing import Any

from flexid.errors import SettingError
from flexid.experiment_design.drive import Drive, Parameters
from flexid.models.flexible_joint import SHAPE_TERMS
from flexid.stored_estimates.estimate_file import EstimateFile, read_estimate, stored_identification
from flexid.toml_file import Refuse, parse_toml, read_bytes, validated

_LARGEST_RAMP = 0.25  # of the duration, at either end
_SLOWEST_SAMPLING = 10.0  # samples per period of the fastest tone
_FEWEST_SAMPLES = 200
_MOST_SAMPLES = 1_000_000


@dataclass(frozen=True)
class DriveFile:
    """A drive and where it was read."""

    drive: Drive
    inputs: tuple[tuple[str, str], ...]  # file names with the SHA-256 of their contents
    warnings: tuple[str, ...] = ()


def read_drive(
    path: Path,
    estimate: Path | Mapping[str, Any] | None = None,
    choices: Mapping[str, Any] | None = None,
) -> DriveFile:
    """Read a drive file."""
    raw = read_bytes(path, "a TOML file", _refusing(path))
    inputs = [(path.name, hashlib.sha256(raw).hexdigest())]
    content = parse_toml(raw, _refusing(path))
    experiment = content.get("experiment")
    if isinstance(experiment, dict):
        experiment.update(choices or {})
    warnings: list[str] = []
    if estimate is not None:
        validated(
            content, Drive, _refusing(path)
        )  # so that each of the two files answers for its own values
        better = read_estimate(estimate)
        inputs.append((Path(better.name).name, hashlib.sha256(better.raw).hexdigest()))
        warnings = _take_over(content, better)
    return DriveFile(_drive(path, content), tuple(inputs), tuple(warnings))


def _refusing(path: Path) -> Refuse:
    return lambda key, reason: SettingError(
        str(path), f"the key {key!r} {reason}" if key else reason
    )


def _take_over(content: dict[str, Any], file: EstimateFile) -> list[str]:
    """Replace parameters by estimates of the same name; returns warnings."""
    estimate = stored_identification(file)
    believed = content["parameters"]
    shapes = [term for term in estimate.choices.terms if term in SHAPE_TERMS]
    missing = [n for n in estimate.parameters if n in Parameters.model_fields and n not in believed]
    warnings = []
    if shapes:
        warnings.append(f"a design does not model {', '.join(shapes)}, so its predictions omit it")
    if missing:
        warnings.append(
            f"{', '.join(missing)} is no parameter of the drive file, so the design leaves it out: "
            f"add the key with any value to use it"
        )
    for name, parameter in estimate.parameters.items():
        if name not in believed:
            continue
        if not isfinite(parameter.value):
            warnings.append(f"{name} has no value there, so that of the drive file stays")
            continue
        believed[name] = parameter.value
        if parameter.verdict == "undetermined":
            warnings.append(
                f"{name} is undetermined there, so the design rests on a guess: check its largest "
                f"deviations"
            )
    validated(believed, Parameters, lambda key, _: _no_drive(file, key, believed))
    return [f"{file.name}: {warning}" for warning in warnings]


def _no_drive(file: EstimateFile, name: str, values: Mapping[str, float]) -> Exception:
    return file.refuse(
        f"parameters.{name}",
        f"is {values[name]}, which no drive has: identify a log that determines it",
    )


def _drive(path: Path, content: dict[str, Any]) -> Drive:
    drive = validated(content, Drive, _refusing(path))
    try:
        _check(drive)
    except SettingError as error:
        raise SettingError(f"{path}: {error.setting}", error.reason) from None
    return drive


def _check(drive: Drive) -> None:
    """Refuse what no experiment can be."""
    wanted = drive.experiment
    for name in drive.known:
        if name != "motor_inertia":
            raise SettingError("known", f"{name!r} cannot be known alone; motor_inertia can")
    for name, value in drive.values.items():
        if value == 0.0:
            raise SettingError(
                f"parameters.{name}",
                "is zero, and no share of zero can be known: leave it out, or give the size that "
                "matters",
            )
    samples = wanted.duration / wanted.sample_time
    if not _FEWEST_SAMPLES <= samples <= _MOST_SAMPLES:
        raise SettingError(
            "experiment.sample_time",
            f"makes {samples:.0f} samples; choose it for {_FEWEST_SAMPLES} to {_MOST_SAMPLES}",
        )
    if wanted.rise > _LARGEST_RAMP * wanted.duration:
        raise SettingError(
            "experiment.ramp", f"is more than {_LARGEST_RAMP:.0%} of the duration: shorten it"
        )
    fastest = drive.fastest
    if fastest * wanted.sample_time * _SLOWEST_SAMPLING > 2.0 * pi:
        raise SettingError(
            "experiment.highest_frequency"
            if wanted.highest_frequency
            else "experiment.sample_time",
            f"leaves fewer than {_SLOWEST_SAMPLING:.0f} samples per period of a tone of "
            f"{fastest:.3g} rad/s: sample faster, or lower highest_frequency",
        )
    if fastest * wanted.duration < 2.0 * pi * wanted.harmonics:
        raise SettingError(
            "experiment.harmonics",
            f"are {wanted.harmonics}, more than {wanted.duration:g} s have between zero and "
            f"{fastest:.3g} rad/s: take fewer, or longer",
        )
