"""Fit of an arm with a disturbance in each balance, for logs that the model does not explain.

The method is described in `flexid.identification.estimation.disturbed`. Here all balances are
fitted at once, and dry friction follows from the motion and sticks. The fit of a stiff joint has
several minima, most of them at values that no arm has: see `as_physical`.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from flexid.arms.fitting import (
    COARSER,
    before_the_end,
    estimate_of,
    no_start,
)
from flexid.arms.unusual import UNUSUAL_FALL, FittedArm
from flexid.arrays import FloatArray
from flexid.errors import ConvergenceError, SettingError
from flexid.estimators.prediction_error import Steps
from flexid.estimators.segmented_motion import balance_columns
from flexid.identification.estimation.band import (
    SPRING_SHARE,
    FitInBand,
    InBand,
    observer_following,
)
from flexid.identification.estimation.thinned_log import factor_of, thinned, thinned_samples
from flexid.identification.full_model.fitting import lengths, motion_at, with_some_zero
from flexid.identification.full_model.model import Data, Structure, encoder_noise, sensor_noise
from flexid.identification.preparation.joint import ElasticArm
from flexid.identification.structure.validation import HORIZONS, validate_with
from flexid.identification.vocabulary.evidence import Estimate, Validation
from flexid.models.planar_arm import carried_links
from flexid.models.torque_balance import TorqueBalance

# Substeps per sample: at most as many as a resonance at the Nyquist frequency needs.
_INTEGRATION = Steps(coarser=COARSER, most_substeps=9)
_STEPS = (4, 8)  # of values; sticking friction makes the minimum rough: more steps gain nothing
_SEGMENT = 5.0  # s: longer than the observer's memory, and short enough to use several cores
_FAR_STEPS, NEAR_STEPS = 6, 3  # of values with fixed gains, from a distant and a near start
RIVAL = 30.0  # rise of -2 log(likelihood) up to which another minimum counts
_LIKELIER = 5.0  # fall of -2 log(likelihood) from which on sizes are fitted too
_TRIED = 2  # starts, the likeliest ones; others rarely reach another minimum
_SLIPS = 0.1  # share of the samples in which a motor that seems to rest may slip
_SAME = 0.1  # standard deviations by which values at one minimum may differ
_FAR = (6.0, 12.0, 24.0)  # standard deviations along the least determined direction
_FLAT = 0.5  # largest rise of the cost over the rise that the curvature predicts

ArmInBand = FitInBand[ElasticArm]


@dataclass(frozen=True, eq=False)
class Job:
    """Structure, log and band of a fit with disturbances."""

    structure: Structure[ElasticArm]
    data: Data  # not yet low-passed
    slowest: float  # in 1/s: slowest rate of a disturbance
    factor: int  # of decimation

    @classmethod
    def of(cls, structure: Structure[ElasticArm], data: Data, start: Mapping[str, float]) -> "Job":
        """Return the job in a band that contains the fastest resonance at `start`."""
        found = resonances(structure.joint.balance, {**structure.fixed, **start})
        slowest = SPRING_SHARE * float(np.exp(np.mean(np.log(found))))
        sample_time = max(recording.sample_time for recording in data.samples)
        factor = factor_of(float(found.max()), sample_time, [*map(len, data.samples)])
        return cls(structure, data, slowest, factor)

    @property
    def balance(self) -> TorqueBalance:
        """Torque balance of the arm."""
        return self.structure.joint.balance

    @property
    def deflections(self) -> tuple[int, ...]:
        """Indices of rows whose position is measured as a deflection."""
        rows = enumerate(self.balance.rows)
        return tuple(place for place, row in rows if row.name in self.data.relative_to)

    @cached_property
    def in_band(self) -> InBand[ElasticArm]:
        """Decimated log; the sign of friction follows from the simulated motion."""
        own = thinned(self.data, self.factor, held=True)
        own = replace(own, noise=encoder_noise(own.samples))
        hold = "zero" if self.factor == 1 else "cubic"
        structure = self.structure.with_hold(hold)
        undirected = np.zeros((0, len(self.balance.rows)))
        noise = sensor_noise(own, self.deflections)
        rest = self.slowest, noise, _SEGMENT, _INTEGRATION, _STEPS
        return InBand(structure, own, undirected, *rest)


@dataclass(frozen=True, eq=False)
class DisturbedFit:
    """Likeliest fit of an arm with disturbances."""

    job: Job
    best: ArmInBand
    rivals: tuple[ArmInBand, ...]  # fits from other starts
    by_delays: tuple[Mapping[str, float], ...] = ()  # errors of the values by other delays

    @property
    def fitted(self) -> FittedArm:
        """Parameters and innovations of the likeliest fit."""
        return self.best.fitted

    @property
    def values(self) -> dict[str, float]:
        """Values of all parameters by name, fitted and fixed."""
        return {**self.job.structure.fixed, **self.fitted.by_name}

    @cached_property
    def estimate(self) -> Estimate:
        """Estimate with standard deviations at least as large as for white noise."""
        return estimate_of(self.fitted).at_least(self.fitted.unit_deviations)

    def disturbing_torques(self) -> FloatArray:
        """Return the RMS torque of the disturbance in each balance, shape (n_rows,)."""
        rows = len(self.job.balance.rows)
        signals = np.zeros((1 + rows, rows, 3))
        signals[1:, :, 2] = np.eye(rows)
        inputs = np.zeros((1 + rows, self.job.balance.joints))
        pi = np.array([self.values[name] for name in self.job.balance.coefficients])
        torques = balance_columns(self.job.balance, signals, inputs) @ pi
        return np.abs(np.diag(torques[1:] - torques[0])) * self.best.sizes.disturbances

    def shares(self) -> dict[str, float]:
        """Return the RMS disturbance over the RMS acceleration, at most 1, by row."""
        squares, count = np.zeros(len(self.job.balance.rows)), 0
        for samples in (
            thinned_samples(r, 2 * self.job.factor, held=True) for r in self.job.data.samples
        ):
            rates = np.diff(samples.positions, 2, axis=0) / samples.sample_time**2
            squares, count = squares + np.sum(rates**2, axis=0), count + len(rates)
        accelerations = np.sqrt(np.maximum(squares / count, np.finfo(float).tiny))
        shares = np.minimum(self.best.sizes.disturbances / accelerations, 1.0)
        names = (row.name for row in self.job.balance.rows)
        return dict(zip(names, shares.tolist(), strict=True))

    def predicted(self) -> tuple[Validation, dict[int, float]]:
        """Predict the last third of each recording with a fit to the first two thirds.

        Returns the validation and, by joint, the fit of its deflection in per cent when it is
        predicted over one period of its resonance.
        """
        job, fitted = self.job, self.fitted
        first, starts = before_the_end(job.data)
        follow = observer_following(job.in_band.directions, self.best.sizes, job.factor)
        periods = job.data.periods(resonances(job.balance, self.values)).tolist()
        try:
            begun = replace(job, data=first).in_band
            values = begun.with_gains_of(fitted, fitted.by_name, NEAR_STEPS).by_name
            segments = lengths(job.data)[-1]
            problem, point = motion_at(job.structure, job.data, segments, values, None)
            problem = replace(_INTEGRATION, coarser=1.0).taken_by(problem)
            arm, rest = job.structure.joint, (job.data.samples, starts, (*HORIZONS, *periods))
            found = validate_with(arm, problem, point.values, *rest, follow)
        except (ConvergenceError, SettingError):
            return Validation({}), {}
        shares = {
            joint: found.horizons[period][f"deflection_{joint}"]
            for joint, period in enumerate(periods, 1)
            if period in found.horizons  # recordings may be too short for it
        }
        usual = {
            horizon: found.horizons[horizon] for horizon in HORIZONS if horizon in found.horizons
        }
        return replace(found, horizons=usual), shares


def likeliest_fit(job: Job, starts: Sequence[Mapping[str, float]]) -> DisturbedFit:
    """Return the likeliest fit from the best starts and from the result made physical."""
    possible = [as_physical(job.balance, start) for start in starts]
    ends: list[ArmInBand] = []
    for tried, start in enumerate(sorted(possible, key=job.in_band.misfit)):
        if tried >= _TRIED and ends:
            break
        with suppress(ConvergenceError):
            _add_fit(job, start, ends)
    if not ends:
        raise no_start()
    with suppress(ConvergenceError):
        _add_fit(job, as_physical(job.balance, ends[0].fitted.by_name), ends)
    best, *rivals = ends
    return DisturbedFit(job, best, tuple(rivals))


def along_flat_directions(found: DisturbedFit) -> DisturbedFit:
    """Search along the least determined direction and without rotor couplings for other minima.

    Sticking friction makes the cost rough: steps may end far from the minimum, where the curvature
    reflects single slips. Returns the likeliest fit; minima about as likely become its rivals.
    """
    ends = [found.best, *found.rivals]
    for start in (*_uncoupled(found), *_far_along(found.fitted)):
        with suppress(ConvergenceError):
            _add_fit(found.job, start, ends)
    best, *rivals = ends
    return replace(found, best=best, rivals=tuple(rivals))


def _uncoupled(found: DisturbedFit) -> Iterator[dict[str, float]]:
    """Yield the best values with all rotor couplings at zero, which is true for most gears.

    With a coupling, inertia can move from link to motor, and stiffness with it, at little cost.
    """
    best, in_band = found.fitted, found.job.in_band
    none = {name: 0.0 for name in best.names if name.startswith("rotor_coupling")}
    structure = replace(in_band.structure, fixed={**in_band.structure.fixed, **none})
    for start in with_some_zero(structure, best):
        with suppress(ConvergenceError):
            bare = replace(in_band, structure=structure)
            yield {**bare.with_gains_of(best, start, _FAR_STEPS).by_name, **none}


def _far_along(fitted: FittedArm) -> Iterator[dict[str, float]]:
    """Yield distant values along the least determined direction where the cost is still low."""
    inverse, deviations = fitted.minimum.reduced.inverse, fitted.unit_deviations
    scale = np.where(deviations > 0.0, deviations, 1.0)
    weakest = np.linalg.eigh(inverse / np.outer(scale, scale))[1][:, -1]
    place = int(np.argmax(np.abs(weakest)))
    direction = inverse[place] / scale[place]
    point = fitted.minimum.point
    for way in (direction, -direction):
        for far in _FAR[::-1]:
            values = point.values + far * way
            moved = fitted.problem.equations(replace(point, values=values), "nothing")
            if moved.cost - _cost(fitted) < _FLAT * far**2:
                yield {**fitted.by_name, **dict(zip(fitted.names, values.tolist(), strict=True))}
                break


def creeping(
    found: DisturbedFit, fixed: Collection[str], starts: Sequence[Mapping[str, float]]
) -> DisturbedFit:
    """Return the fit in which resting motors may creep, if it is clearly likelier than `found`.

    Its parameters outside `fixed` are estimated.
    """
    structure = found.job.structure
    kept = {name: value for name, value in structure.fixed.items() if name in fixed}
    arm = replace(structure.joint, resting=())
    job = replace(found.job, structure=replace(structure, joint=arm, fixed=kept))
    held = {name: value for name, value in structure.fixed.items() if name not in kept}
    slipping = [
        _about_to_slip(found, {**held, **start}) for start in (found.fitted.by_name, *starts)
    ]
    with suppress(ConvergenceError):
        other = likeliest_fit(job, slipping)
        if other.best.cost < found.best.cost - UNUSUAL_FALL:
            return other
    return found


def _about_to_slip(found: DisturbedFit, start: Mapping[str, float]) -> dict[str, float]:
    """Return a start in which friction holds each resting motor during most of the log.

    If the friction exceeded all torques, the motor would never move, and no step would change that.
    """
    moved, samples = dict(start), found.job.data.samples
    for joint in found.job.structure.joint.resting:
        bent = np.concatenate(
            [r.positions[:, 2 * joint - 2] - r.positions[:, 2 * joint - 1] for r in samples]
        )
        torques = np.concatenate([r.inputs[:, joint - 1] for r in samples])
        torques = torques + start[f"joint_stiffness_{joint}"] * (bent - bent.mean())
        carried = carried_links(found.job.balance, joint)
        moved[f"motor_inertia_{joint}"] = sum(abs(start[name]) for name in carried)
        friction = np.quantile(np.abs(torques), 1.0 - _SLIPS)
        moved[f"motor_coulomb_friction_{joint}"] = float(friction)
    return moved


def _cost(fitted: FittedArm) -> float:
    return fitted.minimum.equations.cost


def _add_fit(job: Job, start: Mapping[str, float], ends: list[ArmInBand]) -> None:
    """Fit from a start and add the result to `ends`, if it may be as likely as the best of them.

    The sizes of noise and disturbances are fitted again only if the best fit's make it likelier.
    """
    if ends:
        best = ends[0]
        near = job.in_band.with_gains_of(best.fitted, start, _FAR_STEPS)
        more = _cost(near) - _cost(best.fitted)
        if more > RIVAL or _is_same(near, best.fitted):
            return
        if more > -_LIKELIER:
            ends.append(FitInBand(near, best.sizes, best.cost + more))
            return
        end = job.in_band.fit(near.by_name, best.sizes, near)
    else:
        end = job.in_band.fit(start)
    ends.append(end)
    ends.sort(key=lambda end: end.cost)


def _is_same(near: FittedArm, best: FittedArm) -> bool:
    """Whether two fits ended at the same minimum."""
    moved = np.abs(near.values - best.values)
    return bool((moved <= _SAME * best.unit_deviations).all())


def as_physical(balance: TorqueBalance, start: Mapping[str, float]) -> dict[str, float]:
    """Return a start without negative friction, damping or rotor coupling, but similar motion.

    A stiff joint only shows the sum of link and motor: friction can move from one to the other.
    Inertia can move from the link to the motor if the rotor coupling compensates for it.
    """
    moved = dict(start)
    for joint in range(1, balance.joints + 1):
        for law in ("viscous", "coulomb"):
            link, motor = (f"{side}_{law}_friction_{joint}" for side in ("link", "motor"))
            if motor not in moved:  # the motor rests
                continue
            moved[motor] = max(moved[motor] + moved[link], 0.0)
            moved[link] = 0.0
        moved[f"joint_damping_{joint}"] = max(moved[f"joint_damping_{joint}"], 0.0)
        coupling = f"rotor_coupling_{joint}"
        more = -min(moved.get(coupling, 0.0), 0.0)
        if more > 0.0:
            moved[coupling] = 0.0
            moved[f"motor_inertia_{joint}"] += more
            moved[f"link_inertia_{joint}"] -= more
            before = max(k for k in range(1, joint) if balance.types[k - 1] == "revolute")
            moved[f"link_inertia_{before}"] += more
    return moved


def resonances(balance: TorqueBalance, values: Mapping[str, float]) -> FloatArray:
    """Return the resonance of each joint's motor against its own link, in rad/s."""
    least = np.finfo(float).tiny
    found = []
    for joint in range(1, balance.joints + 1):
        own = carried_links(balance, joint)[0]
        names = (f"joint_stiffness_{joint}", f"motor_inertia_{joint}", own)
        stiffness, motor, link = (max(abs(values[name]), least) for name in names)
        found.append(np.sqrt(stiffness * (1.0 / motor + 1.0 / link)))
    return np.array(found)
