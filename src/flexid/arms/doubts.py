"""Systematic uncertainties of an arm's fit with disturbances that its likelihood does not contain.

Each doubt returns possible errors of the k values as m independent directions, shape (k, m), like
those of one joint in `flexid.identification.estimation.doubts`. Most doubts fit a changed log
again.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from flexid.arms.disturbed import NEAR_STEPS, RIVAL, DisturbedFit
from flexid.arms.fitting import EFFECT_BAND, effect_sizes
from flexid.arms.starts import filtered
from flexid.arms.unusual import STRIBECK, FittedArm, encoder_delays
from flexid.arrays import FloatArray
from flexid.errors import ConvergenceError
from flexid.estimators.channel_timing import INPUT, after_a_lag, later
from flexid.estimators.samples import Samples, Segments, side_by_side
from flexid.estimators.segmented_motion import SegmentedMotion
from flexid.identification.estimation.doubts import (
    ANOTHER_LAW,
    CALIBRATION,
    ECCENTRICITY,
    GAUGE,
    HEAVIER,
    LIKE_A_TERM,
    LIKE_PLAY,
    LIKE_THE_ACCELERATION,
    OF_A_BAND,
    OF_A_HALF,
    OF_A_LAW,
    Repeat,
    between_bands,
    between_halves,
    covariance_of,
    like_a_term,
    widened,
)
from flexid.identification.estimation.rig_errors import (
    SHARE,
    SMALL_SHARE,
    likely_changes,
    with_sensor_error,
)
from flexid.identification.structure.gap import LIKELIER
from flexid.identification.vocabulary.evidence import Estimate
from flexid.identification.vocabulary.thresholds import THRESHOLDS
from flexid.models.flexible_joint import STRIBECK_VELOCITY
from flexid.models.torque_balance import JointTerm, TorqueBalance
from flexid.recording.velocities import position_noise

_SEED = 1  # of the noise added to inputs
_NEVER_NEGATIVE = ("friction", "damping", "coupling")  # unless the model is wrong
_GAPS = np.geomspace(0.02, 1.0, 25)  # half widths over the deflection's standard deviation
# Part of a motor's disturbance that may look like damping of its joint. Errors of damping on 19
# logs with late encoders and wrong laws of friction were 0 to 0.3 of the disturbance, and 0.1 RMS.
_LIKE_DAMPING = 0.1
_CHANCE = 0.005  # random share of the residual squares: 12 of some 2400 independent rows

OF_TIMES = "its channels may not be simultaneous, or a delay may be a lag"
OF_A_ZERO = "the zeros of its encoders or the direction of gravity may be wrong"

Doubt = Callable[[DisturbedFit], FloatArray]


def white_noise(found: DisturbedFit) -> FloatArray:
    """Return the input noise equivalent to each motor's disturbance, shape (n_joints,)."""
    sizes, job = found.best.sizes, found.job
    sample_time = max(recording.sample_time for recording in job.data.samples)
    joints = range(1, job.balance.joints + 1)
    gains = np.array([abs(found.values[f"torque_constant_{joint}"]) for joint in joints])
    spectra = 2.0 / (sizes.rates[1::2] * sample_time)  # over those of white noise
    return found.disturbing_torques()[1::2] * np.sqrt(spectra) / np.maximum(gains, 1e-12)


def input_noise(found: DisturbedFit) -> FloatArray:
    """Return the noise of each logged input, at most `white_noise`, shape (n_joints,)."""
    logged = [[position_noise(c) for c in r.inputs.T] for r in found.job.data.samples]
    return np.minimum(np.max(logged, axis=0), white_noise(found))


def on_time(found: DisturbedFit) -> tuple[Samples, ...]:
    """Return the log with the delays of encoders undone."""
    late = [found.values.get(name, 0.0) for name in encoder_delays(found.job.balance)]
    moved = []
    for recording in found.job.data.samples:
        positions = recording.positions.copy()
        for encoder, delay in zip(positions.T, late, strict=True):
            encoder[:] = later(encoder, -delay / recording.sample_time)
        moved.append(replace(recording, positions=positions))
    return tuple(moved)


def calibration(found: DisturbedFit) -> FloatArray:
    """Return errors due to the scales of the sensors."""
    return CALIBRATION * np.diag(found.fitted.values)


def noise_of_the_inputs(found: DisturbedFit) -> FloatArray:
    """Return the bias due to noise of the logged torque, found by adding as much noise again.

    The mean over noise of both signs is the bias alone (simulation and extrapolation: Cook and
    Stefanski, J. American Statistical Association 89, 1994).
    """
    job, fitted, noise = found.job, found.fitted, input_noise(found)
    rng = np.random.default_rng(_SEED)
    samples = job.data.samples
    drawn = [noise * rng.standard_normal(r.inputs.shape) for r in samples]
    moved = -fitted.values
    for sign in (1.0, -1.0):
        noisy = tuple(
            replace(r, inputs=r.inputs + sign * added)
            for r, added in zip(samples, drawn, strict=True)
        )
        other = replace(job, data=replace(job.data, samples=noisy)).in_band
        moved = moved + 0.5 * other.with_gains_of(fitted, fitted.by_name, NEAR_STEPS).values
    return moved[:, None]


def errors_of_the_rig(found: DisturbedFit) -> FloatArray:
    """Return errors due to encoders, scales, lengths and directions that the log allows."""
    return likely_changes(found.fitted, [*rig_errors(found.fitted, found.job.deflections)])


def zeros_of_joints(found: DisturbedFit) -> FloatArray:
    """Return errors by the zeros of encoders and gravity's direction."""
    return by_zeros(found.fitted)


def by_zeros(fitted: FittedArm) -> FloatArray:
    """Return errors by the zeros of encoders and gravity's direction, weighted by the log."""
    return likely_changes(fitted, [*zeros(fitted)], share=SMALL_SHARE)


def times_of_channels(found: DisturbedFit) -> FloatArray:
    """Return errors by inputs and encoders that are late, or lag."""
    return by_times(found.fitted, found.job.data.samples[0].sample_time)


def by_times(fitted: FittedArm, sample_time: float) -> FloatArray:
    """Return errors by late or lagging inputs, and late encoders, weighted by the log.

    A delay that is too short to be fitted still moves frictions and dampings.
    """
    return likely_changes(fitted, [*other_times(fitted, APART * sample_time)])


def term_law(found: DisturbedFit) -> FloatArray:
    """Return errors by another velocity or law of Stribeck friction."""
    return by_laws(found.fitted)


def by_laws(fitted: FittedArm) -> FloatArray:
    """Return errors by the velocity of Stribeck friction, weighted by the log, and by its law."""
    named = zip(fitted.names, fitted.values, strict=True)
    at_rest = np.diag([ANOTHER_LAW * value * (STRIBECK in name) for name, value in named])
    return np.hstack((likely_changes(fitted, [*other_falls(fitted)]), at_rest))


def halves_of_the_log(found: DisturbedFit) -> FloatArray:
    """Return differences between fits to the halves of the log beyond chance."""
    fitted, halves = found.fitted, []
    for data in found.job.data.halves():
        in_band = replace(found.job, data=data).in_band
        half = in_band.with_gains_of(fitted, fitted.by_name, NEAR_STEPS)
        halves.append(Repeat(half.values, half.unit_deviations**2))
    return between_halves(fitted.values, *halves)


def another_band(found: DisturbedFit) -> FloatArray:
    """Return differences from a fit in a narrower band beyond chance."""
    best, job = found.best, replace(found.job, factor=2 * found.job.factor)
    other = DisturbedFit(job, job.in_band.fit(best.fitted.by_name, best.sizes, best.fitted), ())
    own, narrower = (
        Repeat(each.fitted.values, np.diag(each.estimate.covariance)) for each in (found, other)
    )
    return between_bands(own, [narrower])


def other_minima(found: DisturbedFit) -> FloatArray:
    """Return differences from other minima that are almost as likely."""
    near = [r.fitted for r in found.rivals if r.cost < found.best.cost + RIVAL]
    return _directions([rival.values - found.fitted.values for rival in near], found)


def other_delays(found: DisturbedFit) -> FloatArray:
    """Return errors if other delays are right than the fitted ones."""
    names = found.fitted.names
    return np.array([[errors.get(name, 0.0) for errors in found.by_delays] for name in names])


def unfinished_steps(found: DisturbedFit) -> FloatArray:
    """Return the next step of the fit, which is large if dry friction keeps it from converging."""
    return found.fitted.minimum.reduced.values_step[:, None]


def negative_values(found: DisturbedFit) -> FloatArray:
    """Return the changes of all values if a friction fitted as negative is in fact zero."""
    covariance, values, names = found.estimate.covariance, found.fitted.by_name, found.fitted.names
    places = {name: names.index(name) for name in _negative(found)}
    moved = [-values[name] / covariance[k, k] * covariance[:, k] for name, k in places.items()]
    return _directions(moved, found)


def driving_frictions(found: DisturbedFit) -> frozenset[str]:
    """Return the frictions and dampings that came out farther below zero than noise explains."""
    return frozenset(name for name in _negative(found) if "coupling" not in name)


def _negative(found: DisturbedFit) -> Iterator[str]:
    """Yield values that are never negative, but are here beyond noise."""
    known = zip(found.fitted.names, found.fitted.values, found.estimate.deviations, strict=True)
    for name, value, deviation in known:
        positive = any(word in name for word in _NEVER_NEGATIVE)
        if positive and 0.0 < deviation < np.inf and value < -THRESHOLDS.friction_sign * deviation:
            yield name


def _directions(moved: Sequence[FloatArray], found: DisturbedFit) -> FloatArray:
    return np.reshape(moved, (-1, len(found.fitted.names))).T


def looks_like_a_term(found: DisturbedFit) -> FloatArray:
    """Return errors due to disturbances that resemble a term of their balance."""
    job = found.job
    torques, shares = (
        each * _beyond_input_noise(found)
        for each in (found.disturbing_torques(), np.array([*found.shares().values()]))
    )
    sizes = effect_sizes(job.balance, job.data.samples)
    deviations = {}
    for place, (name, _, term) in enumerate(job.balance.placed()):
        seen = sizes[:, place] > 0.0
        friction = isinstance(term, JointTerm) and "v" in term.expression
        part = np.array([like_a_term(share, friction=friction) for share in shares])
        if seen.any():  # a term of two balances: the better one counts
            deviations[name] = float(((part * torques)[seen] / sizes[seen, place]).min())
    return np.diag([deviations.get(name, 0.0) for name in found.fitted.names])


def _beyond_input_noise(found: DisturbedFit) -> FloatArray:
    """Return the part of each disturbance that cannot be noise of the input, shape (n_rows,)."""
    noise = np.minimum(input_noise(found) / np.maximum(white_noise(found), 1e-300), 1.0)
    beyond = np.ones(2 * len(noise))
    beyond[1::2] = np.sqrt(1.0 - noise**2)
    return beyond


def looks_like_a_delay(found: DisturbedFit) -> FloatArray:
    """Return errors of link encoders' delays due to disturbances that resemble damping.

    In the link's balance a delay resembles damping and friction, so only the motor's balance tells
    them apart.
    """
    job, values = found.job, found.values
    torques = found.disturbing_torques() * _beyond_input_noise(found)
    sizes, names = effect_sizes(job.balance, job.data.samples), job.balance.coefficients
    moved = []
    for joint, delay in enumerate(encoder_delays(job.balance)[::2], 1):
        damping, friction = f"joint_damping_{joint}", f"link_viscous_friction_{joint}"
        motor, stiffness = 2 * joint - 1, values[f"joint_stiffness_{joint}"]
        size = sizes[motor, names.index(damping)]
        if delay in found.fitted.names and size > 0.0 and stiffness > 0.0:
            error = _LIKE_DAMPING * float(torques[motor] / size)
            errors = {damping: error, friction: -error, delay: error / stiffness}
            moved.append(np.array([errors.get(name, 0.0) for name in found.fitted.names]))
    return _directions(moved, found)


def looks_like_the_acceleration(found: DisturbedFit) -> FloatArray:
    """Return errors of inertias due to disturbances that resemble the acceleration."""
    sides = ((*row.split("_"), share) for row, share in found.shares().items())
    kinds = ("inertia", "mass")
    shares = {f"{side}_{kind}_{joint}": share for side, joint, share in sides for kind in kinds}
    named = found.fitted.by_name.items()
    return np.diag([LIKE_THE_ACCELERATION * shares.get(n, 0.0) ** 2 * value for n, value in named])


def play(found: DisturbedFit) -> FloatArray:
    """Return errors of springs due to play, which resembles a softer or hardening spring."""
    changes = changes_by_play(found.job.balance, found.values, on_time(found))
    names = found.fitted.names
    return np.array([[change.get(name, 0.0) for change in changes] for name in names])


DOUBTS: Mapping[Doubt, str] = {
    calibration: "",
    noise_of_the_inputs: "noise of the logged torque: excite harder, or log it finer",
    errors_of_the_rig: "the encoders, their scales, the lengths or directions may be wrong",
    zeros_of_joints: OF_A_ZERO,
    times_of_channels: OF_TIMES,
    term_law: OF_A_LAW,
    halves_of_the_log: OF_A_HALF,
    another_band: OF_A_BAND,
    other_minima: "another set of values explains the log as well",
    other_delays: "delays of the inputs and of the links' encoders are hard to tell apart",
    unfinished_steps: "the fit does not converge",
    negative_values: "a friction or damping came out negative",
    play: LIKE_PLAY,
    looks_like_a_term: LIKE_A_TERM,
    looks_like_a_delay: "an effect that no term describes may look like a late encoder",
    looks_like_the_acceleration: HEAVIER,
}
"""Each doubt, with the reason to state where it makes up most of an interval."""


def with_doubts(found: DisturbedFit) -> tuple[Estimate, dict[str, str]]:
    """Return the estimate with all doubts, and the main reason for each parameter's variance."""
    every = side_by_side(lambda doubt: _directions_of(doubt, found), DOUBTS)
    return widened(found.estimate, zip(map(covariance_of, every), DOUBTS.values(), strict=True))


def with_doubts_of_an_exact_fit(
    fitted: FittedArm, estimate: Estimate
) -> tuple[Estimate, dict[str, str]]:
    """Return the estimate with doubts of zeros, times and friction, and the main reasons."""
    every = []
    own_time = partial(by_times, sample_time=fitted.data.samples[0].sample_time)
    for doubt, words in ((by_zeros, OF_A_ZERO), (own_time, OF_TIMES), (by_laws, OF_A_LAW)):
        with suppress(ConvergenceError):
            every.append((covariance_of(doubt(fitted)), words))
    return widened(estimate, every)


def _directions_of(doubt: Doubt, found: DisturbedFit) -> FloatArray:
    """Return a doubt's directions, or none if its own fit fails."""
    try:
        return doubt(found)
    except ConvergenceError:
        return _directions([], found)


class _Spring(NamedTuple):
    """Spring fitted to a torque, and the sum of squared residuals."""

    stiffness: float
    cubic: float
    left: float


def changes_by_play(
    balance: TorqueBalance, values: Mapping[str, float], recordings: tuple[Samples, ...]
) -> list[dict[str, float]]:
    """Return by parameter how much each joint's spring changes with play, if play is likely.

    The spring's torque equals the rest of the link's balance. Over the deflection it is a straight
    line, a cubic, or either of them beyond a dead zone.
    """
    columns = filtered(balance, recordings, EFFECT_BAND).columns
    pi = np.array([values[name] for name in balance.coefficients])
    found = []
    for joint in range(1, balance.joints + 1):
        own = {
            f"{term.name}_{joint}": k
            for k, (_, number, term) in enumerate(balance.placed())
            if number == joint and isinstance(term, JointTerm) and term.place == "spring"
        }
        row = columns[:, 2 * joint - 2]
        torque = row @ np.where(np.isin(np.arange(len(pi)), [*own.values()]), 0.0, pi)
        names = f"joint_stiffness_{joint}", f"cubic_joint_stiffness_{joint}"
        deflection, cube = (-row[:, own.pop(name)] for name in names)
        rest = -row[:, [*own.values()]]
        curved = values[names[1]] != 0.0
        plain = _fitted_spring(torque, deflection, cube, rest, curved=curved)
        beyond = (deflection - np.clip(deflection, -gap, gap) for gap in _GAPS * np.std(deflection))
        tried = [
            _fitted_spring(torque, zone, zone**3, rest, curved=bent)
            for zone in beyond
            for bent in {False, curved}
        ]
        shares = zip(names, _relative_changes(plain, tried, curved=curved), strict=True)
        found.append({name: values[name] * share for name, share in shares if share})
    return found


def _relative_changes(plain: _Spring, tried: list[_Spring], *, curved: bool) -> tuple[float, float]:
    """Return the largest relative changes of stiffness and hardening with play that is likely.

    For a hardening spring, the residuals with play must be smaller by more than chance. For a
    linear spring they must be 10 % smaller, because play would have been fitted as hardening.
    """
    least = min(spring.left for spring in tried)
    wanted = 1.0 - _CHANCE if curved else LIKELIER
    if plain.stiffness <= 0.0 or least >= wanted * plain.left:
        return 0.0, 0.0
    likely = (spring for spring in tried if spring.left <= least / LIKELIER)
    own = max(likely, key=lambda spring: abs(spring.stiffness - plain.stiffness))
    hardens = own.cubic / plain.cubic - 1.0 if curved and plain.cubic else 0.0
    return own.stiffness / plain.stiffness - 1.0, hardens


def _fitted_spring(
    torque: FloatArray, deflection: FloatArray, cube: FloatArray, rest: FloatArray, *, curved: bool
) -> _Spring:
    columns = np.column_stack((deflection, rest, *([cube] if curved else [])))
    scale = np.maximum(np.abs(columns).max(axis=0), 1e-300)
    solved = np.linalg.lstsq(columns / scale, torque, rcond=None)[0] / scale
    left = torque - columns @ solved
    return _Spring(float(solved[0]), float(solved[-1]) if curved else 0.0, float(left @ left))


LENGTH = 0.005  # relative standard deviation: a ruler misses joints by 1 or 2 mm
DIRECTION = 0.01  # rad, standard deviation of slides, gravity and zeros of encoders: half a degree
APART = 0.5  # samples, standard deviation: channels are read once per sample, in any order
FALL = 0.2  # relative standard deviation of a Stribeck velocity: uniform between the trials


def rig_errors(fitted: FittedArm, deflections: Sequence[int]) -> Iterator[SegmentedMotion]:
    """Yield the fit's motion with each error of the rig at `SHARE` of its standard deviation.

    `deflections` are indices of links whose position is measured as a deflection.
    """
    outputs, types = fitted.problem.segments.outputs, fitted.structure.joint.balance.types
    for motor in range(1, outputs.shape[1], 2):
        yield with_sensor_error(fitted, motor, CALIBRATION * outputs[:, motor])
        link = motor - 1
        if link in deflections:
            bent = outputs[:, link] - outputs[:, motor]
            yield with_sensor_error(fitted, link, GAUGE * bent)
        elif types[link // 2] == "revolute":  # once per turn, with any phase
            for wave in (np.sin, np.cos):
                error = ECCENTRICITY / np.sqrt(2.0) * wave(outputs[:, link])
                yield with_sensor_error(fitted, link, error)
    known = fitted.structure.joint.balance.constants
    last = f"l{len(types)}"  # this length has no effect
    changes = [
        {name: {"l": LENGTH * value, "d": DIRECTION}[name[0]]}
        for name, value in known.items()
        if name[0] in "ld" and name != last
    ]
    for change in filter(lambda one: any(one.values()), changes):
        yield _with_constants(fitted, change)


def zeros(fitted: FittedArm) -> Iterator[SegmentedMotion]:
    """Yield the fit's motion with the zero of each joint at `SMALL_SHARE` of its deviation.

    Moments of links make up for such errors, but along a curve: a larger share would leave it.
    """
    balance = fitted.structure.joint.balance
    gx, gy = balance.constants["gx"], balance.constants["gy"]
    if gx or gy:  # turns with the base, or with the zero of joint 1
        change = {"gx": -DIRECTION * gy, "gy": DIRECTION * gx}
        yield _with_constants(fitted, change, SMALL_SHARE)
    for joint, joint_type in enumerate(balance.types[1:], 1):
        if joint_type == "revolute":
            both = slice(2 * joint, 2 * joint + 2)
            yield with_sensor_error(fitted, both, DIRECTION, SMALL_SHARE)


def other_times(fitted: FittedArm, late: float) -> Iterator[SegmentedMotion]:
    """Yield the fit's motion with each channel late by `SHARE` of a time in s, or with a lag.

    A first-order lag also acts in place of a delay that was found. It reduces the input, and this
    effect grows with its square.
    """
    segments, lag = fitted.problem.segments, np.sqrt(SHARE) * fitted.by_name.get(INPUT, 0.0)
    for inputs in _each_changed(segments, segments.inputs, SHARE * late, 0.0):
        yield replace(fitted.problem, segments=replace(segments, inputs=inputs))
    for inputs in _each_changed(segments, segments.inputs, -lag, lag) if lag > 0.0 else ():
        yield replace(fitted.problem, segments=replace(segments, inputs=inputs))
    for outputs in _each_changed(segments, segments.outputs, SHARE * late, 0.0):
        yield replace(fitted.problem, segments=replace(segments, outputs=outputs))


def _each_changed(
    segments: Segments, channels: FloatArray, late: float, lag: float
) -> Iterator[FloatArray]:
    """Yield the channels, shape (n, m), with each of them late and behind a lag, in s."""
    for place in range(channels.shape[1]):
        changed = channels.copy()
        for part, h in segments.by_recording():
            changed[part, place] = later(after_a_lag(channels[part, place], lag / h), late / h)
        yield changed


def other_falls(fitted: FittedArm) -> Iterator[SegmentedMotion]:
    """Yield the fit's motion with each Stribeck velocity changed by `SHARE` of its deviation."""
    known = fitted.structure.joint.balance.constants
    for name in fitted.names:
        stem, _, joint = name.rpartition("_")
        if stem == STRIBECK:
            velocity = f"{STRIBECK_VELOCITY}_{joint}"
            yield _with_constants(fitted, {velocity: FALL * known[velocity]})


def _with_constants(
    fitted: FittedArm, change: Mapping[str, float], share: float = SHARE
) -> SegmentedMotion:
    """Return a fit's motion with a share of a change of its model's constants."""
    known = fitted.structure.joint.balance.constants
    errors = np.array([change.get(name, 0.0) for name in known])
    return replace(fitted.problem, constants=fitted.problem.constants + share * errors)
