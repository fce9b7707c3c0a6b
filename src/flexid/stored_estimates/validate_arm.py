"""An arm's stored estimate held against other logs, as that of one joint is."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flexid.arms.fitting import noise_of
from flexid.arms.log import ArmLog, read_arm_log
from flexid.arms.result import ArmIdentification
from flexid.arrays import FloatArray
from flexid.errors import RecordingError
from flexid.estimators.balance_motion import balance_motion, balance_unknowns
from flexid.estimators.channel_timing import INPUT, Timing
from flexid.estimators.samples import Samples
from flexid.estimators.segmented_motion import Point
from flexid.estimators.segments import FEWEST_SAMPLES, divide
from flexid.identification.preparation.recordings import check_distinct
from flexid.models.planar_arm import planar_arm
from flexid.recording.caution import Rank, cautions
from flexid.stored_estimates.estimate_file import EstimateFile
from flexid.stored_estimates.validate_estimate import (
    HEAD,
    EstimateValidation,
    Tested,
    common_doubts,
    predicted,
)

_SEGMENT = 1.0  # s of segments about whose starts the steps of the integrator are chosen


@dataclass(frozen=True)
class ArmChannels:
    """Both positions of each joint, and its deflection."""

    joints: int

    @property
    def channels(self) -> tuple[str, ...]:
        """Their names."""
        kinds = ("link_position", "motor_position", "deflection")
        return tuple(f"{kind}_{joint}" for joint in range(1, self.joints + 1) for kind in kinds)

    def channels_of(self, positions: FloatArray, inputs: FloatArray) -> FloatArray:  # noqa: ARG002
        """Channels, shape (n, 3 n_joints), in rad."""
        links, motors = positions[:, ::2], positions[:, 1::2]
        stacked = np.stack((links, motors, links - motors), axis=2)
        return stacked.reshape(len(positions), -1)


def validate_arm(
    file: EstimateFile, stored: ArmIdentification, paths: Sequence[Path], columns: Path | None
) -> EstimateValidation:
    """Predict logs with an arm's estimate as it is; see `validate_estimate`."""
    logs = [read_arm_log(path, stored.arm.joints, columns) for path in paths]
    check_distinct(logs)
    for log in logs:
        if log.input_units != stored.input_units:
            raise RecordingError(
                log.source,
                "input",
                f"is in {', '.join(log.input_units)}, and {file.name} was made with inputs in "
                f"{', '.join(stored.input_units)}: give logs of the same inputs",
            )
    samples = _long_enough(logs)
    channels = ArmChannels(stored.arm.joints)
    noise = noise_of(samples)
    spread = noise.reshape(-1, 2)
    by_channel = np.column_stack((spread, np.hypot(*spread.T))).ravel().tolist()
    balance = planar_arm(stored.arm)
    values = {**stored.fit.by_name, **stored.fixed}
    delays = {INPUT: stored.input_delay} if stored.input_delay else {}
    unknowns = balance_unknowns(balance, dict(stored.fixed))
    timing = Timing(stored.hold, delays)
    problem = balance_motion(balance, divide(samples, _SEGMENT), timing, unknowns)
    sought = np.array([values[name] for name in problem.names])
    problem = problem.at(Point(sought, problem.start_states), 1.0 / noise)
    tested = Tested(
        "arm",
        channels,
        problem,
        sought,
        samples,
        dict(zip(channels.channels, by_channel, strict=True)),
    )
    doubts = cautions(Rank.MODEL, [*common_doubts(stored, stored.parameters, logs)])
    return predicted(file, tested, logs, (*(w for log in logs for w in log.warnings), *doubts))


def _long_enough(logs: Sequence[ArmLog]) -> list[Samples]:
    """Recordings of which something is left to predict."""
    every = [own for log in logs for own in log.recordings]
    found = [own for own in every if len(own) >= round(HEAD / own.sample_time) + FEWEST_SAMPLES]
    if not found:
        raise RecordingError(
            logs[0].source, "", f"holds no recording longer than {HEAD:g} s: record longer"
        )
    return found
