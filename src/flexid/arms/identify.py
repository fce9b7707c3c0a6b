"""The job: the log of an arm, and what is known of it, to a table per joint."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

import flexid
from flexid.arms.fitting import ArmFit, fit_arm
from flexid.arms.log import ArmLog, read_arm_log
from flexid.arms.prediction import free_run
from flexid.arms.result import ArmIdentification, ArmParameter
from flexid.arrays import FloatArray
from flexid.estimators.balance_start import filtered
from flexid.estimators.channel_timing import INPUT
from flexid.identification.judgement.verdict import verdict
from flexid.identification.vocabulary.intervals import interval
from flexid.models.planar_arm import PlanarArm, planar_arm
from flexid.models.torque_balance import BodyTerm, JointTerm, TorqueBalance

REFERENCE = "torque_constant_1"
"""What is fixed at 1 where no torque is calibrated: torques then have the unit of that input."""

_CALIBRATED = "N m"
_EFFECT_BAND = 20.0  # Hz up to which a parameter's share of its balance is taken
_CONFUSED = 0.9  # correlation from which on two parameters are named together
_POOR_FIT = 80.0  # per cent of a free run, below which a warning says so
_WRONG = 10.0  # of what is left over the encoders' noise, from which on no number is trusted
_EXCESS = 1.5  # of what is left over the encoders' noise


def identify_arm(
    path: Path,
    arm: PlanarArm,
    columns: Path | None = None,
    progress: Callable[[str], None] = lambda _step: None,
) -> ArmIdentification:
    """Identify an arm from its log."""
    log = read_arm_log(path, arm.joints, columns)
    balance = planar_arm(arm)
    fixed = fixed_parameters(arm, log.input_units)
    fit = fit_arm(balance, log.recordings, fixed, progress)
    progress("free run")
    return _result(arm, balance, log, fit, fixed, free_run(balance, log.recordings, fit))


def fixed_parameters(arm: PlanarArm, input_units: tuple[str, ...]) -> dict[str, float]:
    """Parameters that are not sought: what cannot show, and what the units say."""
    fixed = {}
    for joint, unit in enumerate(input_units, 1):
        if unit == _CALIBRATED:
            fixed[f"torque_constant_{joint}"] = 1.0
    if not fixed:
        fixed[REFERENCE] = 1.0
    if not arm.has_gravity:  # the first link's moment is felt by gravity alone
        fixed |= {"link_moment_along_1": 0.0, "link_moment_across_1": 0.0}
    return fixed


def _result(
    arm: PlanarArm,
    balance: TorqueBalance,
    log: ArmLog,
    fit: ArmFit,
    fixed: dict[str, float],
    runs: Mapping[str, float],
) -> ArmIdentification:
    names = fit.problem.names
    shares = _shares(balance, log, fit, fixed)
    parameters: dict[str, ArmParameter] = {}
    for name, joint, term in balance.placed():
        if name in names:
            unit = _unit(term, log.input_units, joint)
            parameters[name] = _judged(name, joint, unit, fit, shares.get(name, 0.0))
    for joint in range(1, arm.joints + 1):
        ratio = _ratio(arm, joint, fit, fixed)
        parameters[ratio.name] = ratio
    noise = fit.noise
    left = np.sqrt(np.mean(fit.minimum.equations.residuals[fit.problem.segments.within] ** 2, 0))
    excess = {row.name: float(x) for row, x in zip(balance.rows, left / noise, strict=True)}
    if max(excess.values()) > _WRONG:
        parameters = {name: _doubted(p, excess) for name, p in parameters.items()}
    free = dict(runs)
    return ArmIdentification(
        arm=arm,
        parameters=parameters,
        names=names,
        covariance=fit.covariance,
        fixed=fixed,
        free_run=free,
        residual_excess=excess,
        hold=fit.problem.timing.hold,
        input_delay=fit.values.get(INPUT, 0.0),
        segment_duration=fit.duration,
        condition_number=_condition(fit),
        warnings=(*_warnings(parameters, free, excess), *log.warnings),
        provenance={"flexid_version": flexid.__version__, "inputs": [log.provenance]},
    )


def _judged(name: str, joint: int, unit: str, fit: ArmFit, share: float) -> ArmParameter:
    place = fit.problem.names.index(name)
    value = fit.values[name]
    std = float(np.sqrt(fit.covariance[place, place]))
    freedom = float(fit.degrees_of_freedom[place])
    ends = interval(value, std if freedom > 0.0 else np.inf, freedom)
    effect = share * 0.5 * (ends[1] - ends[0])
    word, reason = verdict(value, ends, effect if np.isfinite(effect) else np.inf)
    if word != "determined":
        reason = "; ".join(filter(None, (reason, _confusion(place, fit))))
    return ArmParameter(name, joint, value, ends, unit, word, reason)


def _confusion(place: int, fit: ArmFit) -> str:
    """Which other parameter the motion does not separate one from."""
    inverse = fit.minimum.reduced.inverse
    spread = np.sqrt(np.diag(inverse))
    if spread[place] == 0.0:
        return ""
    scale = np.where(spread > 0.0, spread, 1.0)
    correlation = np.abs(inverse[place] / (scale * scale[place]))
    correlation[place] = 0.0
    other = int(np.argmax(correlation))
    if correlation[other] < _CONFUSED:
        return ""
    return (
        f"the motion hardly separates it from {fit.problem.names[other]} "
        f"(correlation {correlation[other]:.3f})"
    )


def _doubted(parameter: ArmParameter, excess: dict[str, float]) -> ArmParameter:
    """A parameter of a model that is plainly wrong."""
    worst = max(excess, key=lambda name: excess[name])
    reason = (
        f"the model leaves {excess[worst]:.3g} times the encoder's noise of {worst}, and what it "
        f"lacks may pass for this parameter"
    )
    return replace(parameter, verdict="undetermined", reason=reason)


def _unit(term: JointTerm | BodyTerm, input_units: tuple[str, ...], joint: int) -> str:
    """Unit of a parameter; relative to the first input where no torque is calibrated."""
    first, own = input_units[0], input_units[joint - 1]
    if term.name == "torque_constant":
        return f"N m/{own}" if _CALIBRATED in input_units else f"{first}/{own}"
    if _CALIBRATED in input_units:
        return term.unit
    return (
        term.unit.replace("kg m^2", f"{first} s^2/rad")
        .replace("N m", first)
        .replace("kg m", f"{first} s^2/(m rad)")
    )


def _ratio(arm: PlanarArm, joint: int, fit: ArmFit, fixed: dict[str, float]) -> ArmParameter:
    """Stiffness over the inertia that a joint turns where the arm is straight and motors stand.

    It is the square of the antiresonance with all other joints locked, and needs no scale.
    """
    names, values = fit.problem.names, {**fixed, **fit.values}
    carried = carried_inertia(arm, joint)
    inertia = sum(weight * values[name] for name, weight in carried.items())
    stiffness = f"joint_stiffness_{joint}"
    value = values[stiffness] / inertia if inertia else np.inf
    slopes = {stiffness: 1.0 / inertia if inertia else np.inf}
    slopes |= {name: -value * weight / inertia for name, weight in carried.items() if inertia}
    places = [names.index(name) for name in slopes if name in names]
    gradient = np.array([slopes[names[place]] for place in places])
    freedom = float(fit.degrees_of_freedom[places].min())
    square = float(gradient @ fit.covariance[np.ix_(places, places)] @ gradient)
    std = np.sqrt(square) if freedom > 0.0 and np.isfinite(square) else np.inf
    ends = interval(value, std, freedom)
    word, reason = verdict(value, ends)
    return ArmParameter(
        f"stiffness_over_inertia_{joint}", joint, value, ends, "1/s^2", word, reason
    )


def carried_inertia(arm: PlanarArm, joint: int) -> dict[str, float]:
    """Parameters that make up the inertia that a joint turns, by name, with their weights."""
    n = arm.joints
    found = {f"link_inertia_{k}": 1.0 for k in range(joint, n + 1)}
    for k in range(joint + 1, n + 1):
        found[f"link_moment_along_{k}"] = 2.0 * sum(arm.lengths[joint - 1 : k - 1])
    return found


def _shares(
    balance: TorqueBalance, log: ArmLog, fit: ArmFit, fixed: dict[str, float]
) -> dict[str, float]:
    """Share of the largest torque of its balance that one unit of each parameter makes."""
    values = {**fixed, **fit.values}
    rate = 0.1 / max(recording.sample_time for recording in log.recordings)
    columns = filtered(balance, log.recordings, min(_EFFECT_BAND, rate)).columns
    sizes = np.sqrt(np.mean(columns**2, axis=0))
    own = np.array([abs(values[name]) for name in balance.coefficients])
    largest = (sizes * own).max(axis=1)
    largest = np.where(largest > 0.0, largest, np.inf)
    return dict(
        zip(balance.coefficients, (sizes / largest[:, None]).max(axis=0).tolist(), strict=True)
    )


def _condition(fit: ArmFit) -> float:
    """Condition number of the information, each parameter scaled to a unit diagonal."""
    information: FloatArray = fit.minimum.reduced.information
    scale = np.sqrt(np.maximum(np.diag(information), 0.0))
    if not (scale > 0.0).all():
        return np.inf
    values = np.linalg.eigvalsh(information / np.outer(scale, scale))
    return float(values[-1] / values[0]) if values[0] > 0.0 else np.inf


def _warnings(
    parameters: dict[str, ArmParameter], free: dict[str, float], excess: dict[str, float]
) -> list[str]:
    found = []
    lacking = [p.name for p in parameters.values() if p.verdict == "undetermined"]
    if lacking:
        found.append(
            f"not determined: {', '.join(lacking)}: excite the joints they stand for up to a third "
            f"of the resonance, or use the parameters that are determined"
        )
    poor = {name: share for name, share in free.items() if share < _POOR_FIT}
    if poor:
        worst = min(poor, key=lambda name: poor[name])
        found.append(
            f"a free run over the last third explains {poor[worst]:.0f} % of {worst}: trust the "
            f"parameters of that joint only if this is enough for what they are for"
        )
    worst = max(excess, key=lambda name: excess[name])
    if excess[worst] > _EXCESS:
        found.append(
            f"the residual of {worst} is {excess[worst]:.2g} times the encoder's noise: the arm "
            f"does something that the model does not have, and intervals may be too short"
        )
    return found
