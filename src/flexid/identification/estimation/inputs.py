"""Choice between the logged input and one that is corrected for an amplifier or a filter."""

from contextlib import suppress
from dataclasses import replace
from math import prod
from typing import TYPE_CHECKING

import numpy as np

from flexid.arrays import FloatArray
from flexid.errors import ConvergenceError
from flexid.estimators.channel_timing import INPUT
from flexid.identification.estimation.answers import Answer, answer, answer_again
from flexid.identification.estimation.doubts import coil_error
from flexid.identification.preparation.recordings import IDEAL, Amplifier
from flexid.identification.structure.gap import CHANCE
from flexid.identification.structure.job import Job
from flexid.identification.vocabulary.thresholds import Thresholds

if TYPE_CHECKING:
    from flexid.identification.estimation.encoder_lag import EncoderLag

_CLEAR_GAIN = 0.1  # least relative fall of an exact fit's excess for a corrected input
# Least delay of a filtered input in samples. A filter of less differs from a delay by 0.3 % of a
# motion that is sampled 20 times a period.
_LEAST_SHIFT = 0.25


def answer_with_amplifier(job: Job) -> tuple[Job, Answer, Amplifier]:
    """Return the job with the corrected input, its answer and the amplifier found.

    A voltage is always checked for an amplifier. A torque or a current is checked only if the
    terms alone leave more than noise.
    """
    found = None if job.is_voltage else answer(job)
    if found is not None and (not job.input_unit or _explains(found, job.thresholds)):
        return job, found, IDEAL
    # Imported late: a log whose terms explain it does not need these modules.
    from flexid.identification.estimation.input_lag import lag_error, likely_lag
    from flexid.identification.full_model.amplifier import DrivenBalance

    logged, balance = job, DrivenBalance(job.structure, job.training)
    amplifier = balance.amplifier(is_voltage=job.is_voltage)
    changes = [balance.limit_changes(amplifier)]
    if found is None or amplifier.corrects:
        job = _with_amplifier(amplifier, logged)
        found = answer(job)
    if better := _with_encoder_lag(logged, found, amplifier, of_both=False):
        job, found, (amplifier, change) = better
        changes.append(change)
        positions = replace(IDEAL, link_lag=amplifier.link_lag, motor_lag=amplifier.motor_lag)
        balance = DrivenBalance(job.structure, _with_amplifier(positions, logged).training)
    errors: list[FloatArray] = []
    late = found.fits.reported.by_name.get(INPUT, 0.0)
    if abs(late) > _least_shift(job) and not _explains(found, job.thresholds):
        job.progress("a filter of the input")
        if late < 0.0:
            filtering = balance.with_log_lag(amplifier, -late)
        else:
            filtering = replace(amplifier, lag=likely_lag(found.fits.reported))
        filtered, other = _with_amplifier(filtering, logged), found
        if filtering != amplifier:
            with suppress(ConvergenceError):
                other = answer_again(filtered, found)
        if _is_likelier(other, found):
            job, found, amplifier = filtered, other, filtering
            if late < 0.0:
                changes.append(balance.log_lag_changes(filtering))
            else:
                fitted = found.fits.reported
                errors.append(lag_error(fitted, filtering.lag))
                if job.is_voltage:  # a coil also delays the back-EMF, by as much
                    errors.append(coil_error(fitted, filtering.lag))
    if better := _with_encoder_lag(logged, found, amplifier, of_both=True):
        job, found, (amplifier, change) = better
        changes, errors = [*changes, change], []
    estimate = found.estimate
    shares = ([change.get(name, 0.0) for name in estimate.names] for change in changes)
    for error in (*errors, *(estimate.values * own for own in shares)):
        estimate = estimate.widened(np.outer(error, error))
    return job, replace(found, estimate=estimate), amplifier


def _with_encoder_lag(
    logged: Job, found: Answer, amplifier: Amplifier, *, of_both: bool
) -> "tuple[Job, Answer, EncoderLag] | None":
    """Return the job, the answer and the lag of encoders that leave less than `found`, if any."""
    if logged.joint.kind != "flexible" or amplifier.filters_positions:
        return None
    given = {logged.settings.link_delay, logged.settings.input_delay} != {"auto"}
    if given or _explains(found, logged.thresholds):
        return None
    # Imported late: a log whose terms explain it does not need this module.
    from flexid.identification.estimation.encoder_lag import likely_encoder_lag

    logged.progress("a filter of the encoders")
    delays = {**found.fits.reported.delays}
    delays[INPUT] += amplifier.lag
    undelayed, least = replace(amplifier, lag=0.0), _least_shift(logged)
    rest = logged.structure, logged.training, undelayed, delays, least
    if not (lag := likely_encoder_lag(*rest, of_both=of_both)):
        return None
    filtered = _with_amplifier(lag.amplifier, logged)
    with suppress(ConvergenceError):
        other = answer_again(filtered, found)
        return (filtered, other, lag) if _leaves_less(other, found) else None
    return None


def _least_shift(job: Job) -> float:
    """Least delay in s that may be a filter."""
    return _LEAST_SHIFT * job.training.samples[0].sample_time


def _with_amplifier(amplifier: Amplifier, job: Job) -> Job:
    """Return the job with the amplifier's output as its input, and without filters."""
    recorded = tuple(map(amplifier.behind, job.recordings.recorded))
    return replace(job, recordings=replace(job.recordings, recorded=recorded))


def _is_likelier(other: Answer, found: Answer) -> bool:
    """Whether the other input explains the same data clearly better than the input of `found`."""
    one, two = other.disturbances, found.disturbances
    if (one is None) != (two is None):
        return one is None
    if one is None or two is None:
        return other.fits.reported.excess < (1.0 - _CLEAR_GAIN) * found.fits.reported.excess
    is_same = (one.sample_time, other.retreat) == (two.sample_time, found.retreat)
    return is_same and other.cost < found.cost - CHANCE


def _leaves_less(other: Answer, found: Answer) -> bool:
    """Whether the terms leave less of the accelerations with other positions than in `found`."""
    one, two = other.disturbances, found.disturbances
    if one is None or two is None:
        return _is_likelier(other, found)
    return prod(one.shares.values()) < prod(two.shares.values())


def _explains(found: Answer, thresholds: Thresholds) -> bool:
    """Whether the terms alone leave residuals no larger than noise."""
    fitted = found.fits.reported
    return found.disturbances is None and fitted.excess <= thresholds.sensor_excess
