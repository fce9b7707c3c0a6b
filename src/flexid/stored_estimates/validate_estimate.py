"""Validation of a stored estimate on other logs: predictions over several horizons."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path
from typing import Any, Literal

import numpy as np

import flexid
from flexid.arms.fitting import without_log_lag
from flexid.arms.log import ArmLog, arm_data, read_arm_log
from flexid.arms.result import ArmIdentification
from flexid.arrays import FloatArray
from flexid.errors import RecordingError, SettingError
from flexid.estimators.channel_timing import DELAY, INPUT, Timing
from flexid.estimators.samples import FEWEST_SAMPLES, Samples, divide
from flexid.files import RefuseKey
from flexid.identification.full_model.fitting import motion_at
from flexid.identification.full_model.model import Data, Structure, data_of
from flexid.identification.preparation.joint import ElasticArm, Joint, Kind
from flexid.identification.preparation.recordings import Source, check_alike, check_distinct, traits
from flexid.identification.result import Identification
from flexid.identification.structure.validation import Channels, validate_with
from flexid.identification.vocabulary.evidence import Validation, ValueEstimate
from flexid.models.motion import JointType
from flexid.models.planar_arm import planar_arm
from flexid.recording.recording import Log, Rank, Recording, cautions, ranked
from flexid.recording.velocities import position_noise
from flexid.stored_estimates.estimate_file import WANTED, StoredEstimate
from flexid.stored_estimates.structure import structure_of, values_of

HEAD = 0.5  # seconds at the start of each recording that determine its initial state

_SEGMENT = 1.0  # s; length of the segments from which the integrator's steps are chosen


@dataclass(frozen=True, kw_only=True)
class EstimateValidation(Validation):
    """Predictions of logs by an estimate that was not fitted to them."""

    model: Kind | Literal["arm"]
    residuals: Mapping[float, Mapping[str, float]]
    noise: Mapping[str, float]  # standard deviation of each channel's noise
    types: tuple[JointType, ...]  # of each joint; they determine the units of the channels
    warnings: tuple[str, ...] = ()  # limits of the validation
    provenance: Mapping[str, Any] = field(default_factory=dict)


def validate_estimate(estimate: StoredEstimate, logs: Sequence[Log]) -> EstimateValidation:
    """Predict logs with a stored estimate; only the initial states are fitted."""
    stored = estimate.of_joint
    values = values_of(stored)
    structure = _structure(stored, values, estimate.refuse)
    joint = structure.joint
    check_distinct(logs)
    recordings, dropped = _recordings(logs, joint.kind)
    _check_same_drive(estimate.name, stored, logs)
    recordings = [stored.choices.amplifier.behind(recording) for recording in recordings]
    data = data_of(joint, recordings, [0] * len(recordings))
    doubts = [*common_doubts(stored, stored.coefficients, logs)]
    if offsets := dict.fromkeys(n.partition("[")[0] for n in stored.coefficients if "[" in n):
        named = " and ".join(offsets)
        doubts.append(f"the estimate has {named} for each log: these logs get the mean")
    warnings = (*dropped, *cautions(Rank.MODEL, doubts))
    return _predicted(estimate, structure, values, data, logs, warnings)


def _predicted(
    estimate: StoredEstimate,
    structure: Structure[Any],
    values: Mapping[str, float],  # of its coefficients
    data: Data,
    logs: Sequence[Log] | Sequence[ArmLog],
    warnings: Sequence[str],
) -> EstimateValidation:
    """Return predictions of each recording but its first half second."""
    result = estimate.result
    problem, point = motion_at(structure, data, divide(data.samples, _SEGMENT), values, None)
    channels, samples = structure.joint, data.samples
    starts = [round(HEAD / recording.sample_time) for recording in samples]
    try:
        with np.errstate(all="ignore"):
            found = validate_with(channels, problem, point.values, samples, starts)
    except np.linalg.LinAlgError:
        raise SettingError(
            estimate.name, "diverges on this log: give an estimate of the same drive"
        ) from None
    return EstimateValidation(
        found.fit_percent,
        found.runs,
        found.horizons,
        model=result.model,
        types=(result.joint,) if isinstance(result, Identification) else result.arm.types,
        residuals=_residuals(found, channels, samples, starts),
        noise=_noise(channels, data),
        warnings=ranked([*(w for log in logs for w in log.warnings), *warnings]),
        provenance={
            "flexid_version": flexid.__version__,
            "estimate": {"file": estimate.name, "sha256": estimate.sha256},
            "inputs": [log.provenance for log in logs],
        },
    )


def _structure(stored: Identification, values: Mapping[str, float], refuse: RefuseKey) -> Structure:
    for name, found in stored.coefficients.items():
        if not isfinite(found.value):
            raise refuse(f"coefficients.{name}.value", "is not a number: identify again")
    try:
        structure = structure_of(stored, values)
    except SettingError as error:
        raise refuse("", f"cannot be simulated: {error}") from None
    for term in stored.choices.terms:
        if term not in structure.joint.terms:
            raise refuse(
                "choices.terms",
                f"has {term[:40]!r}, no term of the {stored.model} joint: give {WANTED} of this "
                f"version",
            )
    return structure


def _recordings(logs: Sequence[Log], kind: Kind) -> tuple[list[Recording], list[str]]:
    """Return the recordings that are long enough, and a warning for each other one."""
    recordings, dropped = [], []
    for recording in (recording for log in logs for recording in log.recordings):
        if kind != "rigid" and recording.link_position is None:
            raise RecordingError(
                recording.source,
                "link_position",
                "is missing, and the estimate is of a joint with two encoders: give logs of both",
            )
        fewest = round(HEAD / recording.sample_time) + FEWEST_SAMPLES
        if len(recording) >= max(fewest, 2 * FEWEST_SAMPLES):
            recordings.append(recording)
        else:
            dropped.append(
                f"{recording.source}: the {len(recording)} samples from {recording.start_time:g} s "
                f"on are too few for a prediction and are left out"
            )
    if not recordings:
        raise RecordingError(
            logs[0].source, "", f"has no recording longer than {HEAD:g} s: record longer"
        )
    return recordings, dropped


def _check_same_drive(name: str, stored: Identification, logs: Sequence[Log]) -> None:
    """Raise if the logs have another joint type or another input than the estimate."""
    check_alike(logs)
    first = logs[0].recordings[0]
    # A link alone is driven by the motor's motion, so an input in the logs does not count.
    unit = first.input_unit if stored.input_unit else ""
    known = traits(stored.joint, stored.input_unit)
    for channel, words in traits(first.joint, unit).items():
        if words != known[channel]:
            reason = f"is {words}, and in {name} {known[channel]}: give logs of the same drive"
            raise RecordingError(first.source, channel, reason)


def _residuals(
    found: Validation, channels: Channels, samples: Sequence[Samples], starts: Sequence[int]
) -> dict[float, dict[str, float]]:
    """Return the root mean square of each channel's prediction error, by horizon in s."""
    squares = sum(np.sum((run.measured - run.simulated) ** 2, axis=0) for run in found.runs)
    free = np.sqrt(np.asarray(squares) / sum(len(run.time) for run in found.runs))
    measured = [
        channels.channels_of(p.positions, p.inputs)[s:]
        for p, s in zip(samples, starts, strict=True)
    ]
    deviations = sum(np.sum((y - y.mean(axis=0)) ** 2, axis=0) for y in measured)
    spread = np.sqrt(np.asarray(deviations) / sum(map(len, measured)))
    by_horizon = {
        horizon: _by_channel(channels, (1.0 - np.array(list(fits.values())) / 100.0) * spread)
        for horizon, fits in found.horizons.items()
    }
    return {**by_horizon, np.inf: _by_channel(channels, free)}


def _noise(model: Channels, data: Data) -> dict[str, float]:
    """Return the noise's standard deviation by channel; both positions add to the deflection's."""
    kind = model.kind if isinstance(model, Joint) else "flexible"
    noise = data.noise
    if kind == "rigid":
        return _by_channel(model, noise)
    if kind == "link":
        noise = np.append(noise, position_noise(max(data.samples, key=len).inputs[:, 0]))
    sides = noise.reshape(-1, 2)
    every = np.column_stack((sides, np.hypot(*sides.T))).ravel()
    return _by_channel(model, every[::2] if kind == "link" else every)


def _by_channel(model: Channels, numbers: FloatArray) -> dict[str, float]:
    return dict(zip(model.channels, map(float, numbers), strict=True))


def common_doubts(
    stored: Identification | ArmIdentification,
    values: Mapping[str, ValueEstimate],
    logs: Sequence[Source],
) -> Iterator[str]:
    """Yield a sentence for each limit of a validation, of a joint or of an arm."""
    inputs = stored.provenance.get("inputs", ())
    fitted = {source["sha256"] for source in inputs if source.get("sha256")}
    for log in logs:
        if log.sha256 in fitted:
            yield (
                f"the estimate was made from {log.source}: its prediction is no independent test"
            )
    guessed = [name for name, value in values.items() if value.verdict == "undetermined"]
    if guessed:
        yield (
            f"the estimate leaves {', '.join(guessed)} undetermined: its predictions depend on a "
            f"guess"
        )


def validate_arm(
    estimate: StoredEstimate, paths: Sequence[Path], columns: Path | None
) -> EstimateValidation:
    """Predict logs with an arm's stored estimate; see `validate_estimate`."""
    stored = estimate.result
    assert isinstance(stored, ArmIdentification)
    logs = [read_arm_log(path, stored.arm.types, columns) for path in paths]
    check_distinct(logs)
    for log in logs:
        if log.input_units != stored.input_units:
            raise RecordingError(
                log.source,
                "input",
                f"is in {', '.join(log.input_units)}, and {estimate.name} was made with inputs in "
                f"{', '.join(stored.input_units)}: give logs of the same inputs",
            )
    every = [own for log in logs for own in log.recordings]
    long = [own for own in every if len(own) >= round(HEAD / own.sample_time) + FEWEST_SAMPLES]
    if not long:
        raise RecordingError(
            logs[0].source, "", f"has no recording longer than {HEAD:g} s: record longer"
        )
    logged = arm_data(long, logs[0].relative_to)
    data = without_log_lag(logged, stored.log_lag)
    arm = ElasticArm(planar_arm(stored.arm))
    delays = {f"{row}{DELAY}": delay for row, delay in stored.encoder_delays.items()}
    delays |= {INPUT: stored.input_delay} if stored.input_delay else {}
    structure = Structure(arm, frozenset(), Timing(stored.hold, delays), stored.fixed)
    doubts = cautions(Rank.MODEL, [*common_doubts(stored, stored.parameters, logs)])
    return _predicted(estimate, structure, stored.fit.by_name, data, logs, doubts)
