"""Identification of an arm from its log and known geometry."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

import flexid
from flexid.arms.disturbed import along_flat_directions, creeping
from flexid.arms.disturbed_terms import fit_disturbed
from flexid.arms.doubts import driving_frictions, with_doubts, with_doubts_of_an_exact_fit
from flexid.arms.fitting import (
    effect_sizes,
    exact_fits,
    explains,
    has_ended,
    no_start,
    predicted,
    residual_excess,
    without_log_lag,
)
from flexid.arms.log import ArmLog, read_arm_log
from flexid.arms.result import ArmIdentification, joint_of_name
from flexid.arms.starts import backward_inputs, readings, unexplained
from flexid.arms.units import ArmUnits
from flexid.arms.unusual import FittedArm, encoder_delays
from flexid.errors import ConvergenceError, RecordingError
from flexid.estimators.channel_timing import DELAY, INPUT, Timing
from flexid.estimators.excitation import excitation_of_gram
from flexid.identification.estimation.spring_doubts import PREDICTED, UNEXPLAINED, weak_spring
from flexid.identification.full_model.model import Structure
from flexid.identification.judgement import judged_function, judged_value
from flexid.identification.preparation.joint import ElasticArm
from flexid.identification.preparation.recordings import Amplifier
from flexid.identification.result import (
    amplifier_warnings,
    model_warnings,
    sign_warnings,
    validation_warnings,
)
from flexid.identification.vocabulary.evidence import (
    Disturbances,
    Estimate,
    ModelError,
    Validation,
    ValueEstimate,
)
from flexid.models.physical import Quotient
from flexid.models.planar_arm import STRIBECK_CONSTANTS, PlanarArm, carried_links, planar_arm
from flexid.recording.recording import INPUTS, Caution, Rank, ranked
from flexid.recording.velocities import is_noise

_CORRELATED = 0.9  # least correlation that is reported
_OF_A_SPRING = ("joint_stiffness", "joint_damping", "motor_inertia", "stiffness_over_inertia")
_HELD = {
    "motor_inertia": 1e3,
    "motor_viscous_friction": 0.0,
    "motor_coulomb_friction": 1e9,
    "motor_offset": 0.0,
    "torque_constant": 1.0,
    "rotor_coupling": 0.0,
}
"""Assumed parameters of a motor that rests: a very large friction holds it in place."""
_POSITIVE = ("joint_stiffness", "motor_inertia", "link_inertia", "link_mass")
# Unexplained part with another reading of the angles, over that as read: 0.5 or more in 210 right
# logs, mostly 0.01 or less in wrong ones.
_FAR_BETTER = 0.1
_HARDLY = 0.25  # motion of a motor over that of its link; wrong gear ratios give less
_UNCONVERGED = 10.0  # standard deviations of the next step; sticking friction causes up to 3
_NO_TORQUE = 1e-100  # N m, in place of zero if no torque of a balance is known


def identify_arm(
    path: Path,
    arm: PlanarArm,
    columns: Path | None = None,
    progress: Callable[[str], None] = lambda _step: None,
) -> ArmIdentification:
    """Identify an arm from its log."""
    log = read_arm_log(path, arm.types, columns)
    fixed = fixed_parameters(arm, ArmUnits(arm.types, log.input_units, log.resting))
    _check_signs(log, arm, fixed)
    _check_reading(log, arm, fixed)
    model = ElasticArm(planar_arm(arm), log.resting)
    held = held_motors(model)
    structure = Structure(model, frozenset(), Timing("zero"), held | fixed)
    found = _chosen_fit(structure, fixed, log, progress)
    return _result(arm, log, found)


def _check_signs(log: ArmLog, arm: PlanarArm, fixed: dict[str, float]) -> None:
    """Raise if a positive input turns its joint backwards."""
    resting = [joint - 1 for joint in log.resting]
    backward = backward_inputs(planar_arm(arm), log.recordings, fixed, resting)
    if backward:
        columns = log.provenance["joints"]
        names = " and ".join(
            f"{channel}_{place + 1}"
            for place in backward
            for channel in (*INPUTS, "deflection")
            if channel in columns[place]
        )
        reason = "a positive value turns its joint backwards: scale it by -1 in a column map"
        if "deflection" in names:
            reason += ", or the deflection, which is the link's angle minus the motor's"
        raise RecordingError(log.source, names, reason)


def _check_reading(log: ArmLog, arm: PlanarArm, fixed: dict[str, float]) -> None:
    """Raise if another sense or zero of the angles explains the log far better."""
    units = ArmUnits(arm.types, log.input_units, log.resting)
    resting = [joint - 1 for joint in log.resting]
    left = {
        means: unexplained(planar_arm(other), recordings, fixed_parameters(other, units), resting)
        for means, other, recordings in readings(arm, log.recordings)
    }
    most = _FAR_BETTER * unexplained(planar_arm(arm), log.recordings, fixed, resting)
    better = {means: share for means, share in left.items() if share < most}
    if better:
        means = min(better, key=lambda one: better[one])
        reason = f"the arm's mechanics explain the log far better if {means}"
        raise RecordingError(log.source, "", reason)


@dataclass(frozen=True, eq=False)
class _ChosenFit:
    """Chosen fit of an arm with its estimate, validation and reasons."""

    fitted: FittedArm
    estimate: Estimate
    validation: Validation
    periods: Mapping[int, float]  # fit in % of each deflection, predicted over a period
    shares: Mapping[str, float] | None = None  # RMS disturbance over acceleration, or None
    widest: Mapping[str, str] = field(default_factory=dict)  # main reason for an interval
    driving: frozenset[str] = frozenset()  # frictions that came out negative beyond noise
    reason: str = ""  # why disturbances are needed
    log_lag: float = 0.0  # s, of a filter through which the inputs were logged


def _chosen_fit(
    structure: Structure[ElasticArm],
    fixed: Mapping[str, float],
    log: ArmLog,
    progress: Callable[[str], None],
) -> _ChosenFit:
    """Return the fit without disturbances or, if its residuals are too large, the one with them.

    If a motor creeps that seemed to rest, its parameters are fitted, except those in `fixed`.
    """
    exact = exact_fits(structure, log.data, progress)
    best, reason = None, exact.failure
    if not reason:
        progress("intervals")
        best = exact.best()
        reason = "" if explains(best[0]) else "residuals exceed the encoders' noise"
    if best is None or reason:
        progress("disturbances")
        with suppress(ConvergenceError):
            data = without_log_lag(log.data, exact.log_lag)
            disturbed = fit_disturbed(exact.structure, data, exact.starts)
            still = (r.positions[:, 2 * joint - 1] for r in log.recordings for joint in log.resting)
            if not all(map(is_noise, still)):
                disturbed = creeping(disturbed, fixed, exact.starts)
            disturbed = along_flat_directions(disturbed)
            progress("systematic errors")
            doubted, widest = with_doubts(disturbed)
            if not any(doubted.degrees_of_freedom):
                raise ConvergenceError("arm", "the fit with disturbances determines no parameter")
            progress("predicting the held-out data")
            runs, shares = disturbed.predicted(), disturbed.shares()
            rest = shares, widest, driving_frictions(disturbed), reason, exact.log_lag
            return _ChosenFit(disturbed.fitted, doubted, *runs, *rest)
    if not exact.found:
        raise no_start()
    progress("predicting the held-out data")
    fitted, estimate = best or exact.best()
    estimate, widest = with_doubts_of_an_exact_fit(fitted, estimate)
    runs, rest = (predicted(fitted), {}), {"reason": reason, "log_lag": exact.log_lag}
    return _ChosenFit(fitted, estimate, *runs, widest=widest, **rest)


def fixed_parameters(arm: PlanarArm, units: ArmUnits) -> dict[str, float]:
    """Return fixed parameters: zeros for unusual terms, and torque constants given by units.

    If no torque is calibrated, the torque constant of the first joint that moves is 1.
    """
    fixed = dict.fromkeys(planar_arm(arm).unusual, 0.0)
    known = units.calibrated or (units.reference,)
    fixed |= {f"torque_constant_{joint}": 1.0 for joint in known}
    if arm.types[0] == "revolute" and not arm.has_gravity:
        # Only gravity makes the first link's moment matter.
        fixed |= {"link_moment_along_1": 0.0, "link_moment_across_1": 0.0}
    return fixed


def held_motors(model: ElasticArm) -> dict[str, float]:
    """Return assumed parameters of the motors that rest, by name."""
    held = {f"{name}_{joint}": value for joint in model.resting for name, value in _HELD.items()}
    return {name: value for name, value in held.items() if name in model.balance.coefficients}


def _result(arm: PlanarArm, log: ArmLog, found: _ChosenFit) -> ArmIdentification:
    fitted, estimate = found.fitted, found.estimate
    structure = fitted.structure
    balance, fixed = structure.joint.balance, structure.fixed
    parameters: dict[str, ValueEstimate] = {}
    shares = _shares(found, log)
    units = ArmUnits(arm.types, log.input_units, log.resting)
    for name, joint, term in balance.placed():
        unit = units.of(term, joint)
        if name in fitted.names:
            parameters[name] = _judged(name, unit, found, shares)
        elif (
            joint in structure.joint.resting
            and term.name in _HELD
            and not (term.name == "torque_constant" and joint in units.calibrated)
        ):
            unknown = np.nan, np.inf, (-np.inf, np.inf), "undetermined"
            parameters[name] = ValueEstimate(name, unit, *unknown)
    for joint in range(1, arm.joints + 1):
        ratio = _ratio(arm, joint, {**fixed, **fitted.by_name}, estimate)
        parameters[ratio.name] = ratio
    rows = (row.name for row in balance.rows)
    excess = dict(zip(rows, residual_excess(fitted).tolist(), strict=True))
    doubts = [*_doubts(found, parameters, excess)]
    for names_doubted, doubt in doubts:
        for name in names_doubted & parameters.keys():
            parameters[name] = parameters[name].unknown(str(doubt))
    velocities, exponents = (
        [balance.constants[f"{name}_{j}"] for j in range(1, arm.joints + 1)]
        for name in STRIBECK_CONSTANTS
    )
    return ArmIdentification(
        model="arm",
        arm=replace(arm, stribeck=tuple(zip(velocities, exponents, strict=True))),
        parameters=parameters,
        fit=estimate,
        fixed=fixed,
        input_units=log.input_units,
        disturbances=found.shares,
        disturbed_because=found.reason,
        residual_excess=excess,
        # The low-passed input of a fit with disturbances is smooth; the logged one was held.
        hold=structure.timing.hold if found.shares is None else "zero",
        input_delay=fitted.delays[INPUT],
        log_lag=found.log_lag,
        segment_duration=fitted.problem.segments.mean_duration,
        condition_number=excitation_of_gram(
            "arm", fitted.names, fitted.information
        ).condition_number,
        warnings=ranked(
            (*log.warnings, *(doubt for _, doubt in doubts), *_warnings(parameters, found))
        ),
        provenance={"flexid_version": flexid.__version__, "inputs": [log.provenance]},
        encoder_delays={
            name.removesuffix(DELAY): fitted.by_name[name]
            for name in encoder_delays(balance)
            if name in fitted.by_name
        },
        validation=found.validation,
    )


def _judged(name: str, unit: str, found: _ChosenFit, shares: Mapping[str, float]) -> ValueEstimate:
    made = judged_value(name, unit, *found.estimate.of(name), shares.get(name, 0.0))
    return made.because(found.widest.get(name, ""), _confusion(name, found.fitted))


def _confusion(name: str, fitted: FittedArm) -> str:
    """Return a sentence on the strongest correlation with another parameter, if it is strong."""
    place = fitted.names.index(name)
    inverse, spread = fitted.minimum.reduced.inverse, fitted.unit_deviations
    if spread[place] == 0.0:
        return ""
    scale = np.where(spread > 0.0, spread, 1.0)
    correlation = np.abs(inverse[place] / (scale * scale[place]))
    correlation[place] = 0.0
    other = int(np.argmax(correlation))
    if correlation[other] < _CORRELATED:
        return ""
    return (
        f"the motion hardly separates it from {fitted.names[other]} "
        f"(correlation {correlation[other]:.3f})"
    )


def _doubts(
    found: _ChosenFit, parameters: Mapping[str, ValueEstimate], excess: Mapping[str, float]
) -> Iterator[tuple[set[str], Caution]]:
    """Yield sets of parameters to declare undetermined, each with its reason."""
    if found.shares is None and found.reason:
        worst = max(excess, key=lambda name: excess[name])
        reason = (
            f"the residual of {worst} is {excess[worst]:.3g} times the encoder's noise, and no "
            f"disturbances explain it: check units, signs, lengths, gear ratios and leads"
        )
        yield {*parameters}, Caution(reason, Rank.SCALE)
    if found.shares is not None and found.fitted.minimum.last_step > _UNCONVERGED:
        reason = "the fit does not converge: let the joints swing faster, or log for longer"
        yield {*parameters}, Caution(reason, Rank.MOTION)
    for joint in found.fitted.structure.joint.resting:
        # So little motion does not separate gravity from the spring.
        carried = {f"link_inertia_{joint}", f"link_mass_{joint}"}
        own = {n for n in parameters if joint_of_name(n) == joint} - carried
        yield own, Caution(f"joint {joint} rests: let it move", Rank.MOTION)
    yield from weak_springs(found.fitted, found.periods, found.shares or {})
    yield from negative_springs(parameters, ended=has_ended(found.fitted))


def weak_springs(
    fitted: FittedArm, periods: Mapping[int, float], shares: Mapping[str, float]
) -> Iterator[tuple[set[str], Caution]]:
    """Yield parameters to declare undetermined because a spring predicts too little.

    A motor that hardly moves must then have a wrong gear ratio, or a dead encoder.
    """
    for joint, share in periods.items():
        left = max(shares.get(f"{side}_{joint}", 0.0) for side in ("link", "motor"))
        if left <= UNEXPLAINED or share >= PREDICTED:
            continue
        weak = weak_spring(f"joint {joint}", "a period", f"{max(share, 0.0):.0f} %")
        yield {f"{name}_{joint}" for name in _OF_A_SPRING}, weak
        both = slice(2 * joint - 2, 2 * joint)
        link, motor = np.concatenate([r.positions[:, both] for r in fitted.data.samples]).std(0)
        if motor < _HARDLY * link:
            reason = (
                f"the motor of joint {joint} moves {motor / link:.2g} times as much as its link, "
                f"as if it was held, but no spring moves the link like this: check the gear ratio "
                f"and the motor's encoder"
            )
            yield set(), Caution(reason, Rank.SCALE)


def negative_springs(
    parameters: Mapping[str, ValueEstimate], *, ended: bool
) -> Iterator[tuple[set[str], Caution]]:
    """Yield parameters to declare undetermined because a spring or an inertia came out negative.

    Without an `ended` fit these are those of all joints: it may have diverged, and the links are
    coupled. But other joints do not depend on a value that the log leaves free.
    """
    for joint in {*map(joint_of_name, parameters)}:
        own = (parameters.get(f"{name}_{joint}") for name in _POSITIVE)
        negative = [parameter for parameter in own if parameter and parameter.value <= 0.0]
        if negative:
            alone = ended or all(np.isinf(parameter.std) for parameter in negative)
            doubted = {name for name in parameters if joint_of_name(name) == joint or not alone}
            yield doubted, doubt_of_negative(negative)


def doubt_of_negative(found: Sequence[ValueEstimate]) -> Caution:
    """Return the warning about negative springs or inertias, by whether they may be positive."""
    names = ", ".join(parameter.name for parameter in found)
    problem = f"{names} came out negative, which no spring, inertia or mass can be"
    if any(parameter.interval[1] < 0.0 for parameter in found):
        return Caution(f"{problem}: check the signs of this joint", Rank.SCALE)
    return Caution(f"{problem}; the interval includes positive values", Rank.MODEL)


def _ratio(
    arm: PlanarArm, joint: int, values: Mapping[str, float], estimate: Estimate
) -> ValueEstimate:
    """Return stiffness over the inertia that a joint moves, with a straight arm and slides at 0.

    It is the square of the antiresonance with all motors locked, and independent of input scale.
    """
    name, stiffness = f"stiffness_over_inertia_{joint}", f"joint_stiffness_{joint}"
    ratio = Quotient(name, "1/s^2", stiffness, carried_inertia(arm, joint))
    return judged_function(ratio, values, estimate)


def carried_inertia(arm: PlanarArm, joint: int) -> dict[str, float]:
    """Return weights of the parameters whose sum is the inertia or mass that a joint moves."""
    found = dict.fromkeys(carried_links(planar_arm(arm), joint), 1.0)
    if arm.types[joint - 1] == "prismatic":
        return found
    for k in range(joint + 1, arm.joints + 1):
        reach = sum(arm.lengths[joint - 1 : k - 1])
        found[f"link_moment_along_{k}"] = 2.0 * reach
        if arm.types[k - 1] == "prismatic":
            found[f"link_mass_{k}"] = reach**2
    return found


def _shares(found: _ChosenFit, log: ArmLog) -> dict[str, float]:
    """Return the torque of one unit of each parameter over the largest one of its balance."""
    structure, estimate = found.fitted.structure, found.estimate
    balance = structure.joint.balance
    known = zip(estimate.names, estimate.values, estimate.deviations, strict=True)
    values = {**structure.fixed, **{n: v for n, v, std in known if std < abs(v)}}
    sizes = effect_sizes(balance, log.recordings)
    own = np.array([abs(values.get(name, 0.0)) for name in balance.coefficients])
    largest = np.maximum((sizes * own).max(axis=1), _NO_TORQUE)
    shares = (sizes / largest[:, None]).max(axis=0)
    return dict(zip(balance.coefficients, shares.tolist(), strict=True))


def _warnings(parameters: dict[str, ValueEstimate], found: _ChosenFit) -> Iterator[Caution]:
    lacking = [p.name for p in parameters.values() if p.verdict == "undetermined"]
    if lacking:
        yield Caution(
            f"not determined: {', '.join(lacking)}: excite their joints up to a third of the "
            f"resonance, or use only the parameters that are determined",
            Rank.MOTION,
        )
    yield from amplifier_warnings(Amplifier(log_lag=found.log_lag), "")
    if found.shares is not None:
        disturbances = Disturbances(found.shares, found.fitted.data.samples[0].sample_time)
        yield from model_warnings(ModelError(0.0, 0.0, 0.0), "flexible", 0.0, disturbances)
        yield from sign_warnings({}, found.driving)
        return
    resting = {f"motor_position_{joint}" for joint in found.fitted.structure.joint.resting}
    fits = found.validation.fit_percent
    yield from validation_warnings({n: fit for n, fit in fits.items() if n not in resting})
