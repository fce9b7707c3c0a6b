"""Identification job from logs and settings, and the search for the structure."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import nullcontext, suppress
from dataclasses import dataclass, replace
from functools import cached_property, partial

from flexid.errors import ConvergenceError, SettingError
from flexid.estimators.budget import renewed
from flexid.estimators.channel_timing import INPUT, Timing
from flexid.identification.full_model.fits_by_length import (
    TURNING,
    FitsByLength,
    explains,
    fit_full_model,
    turning,
)
from flexid.identification.full_model.model import LINK, Data, Fitted, Structure, data_of
from flexid.identification.preparation.joint import Joint, Kind, joint_of
from flexid.identification.preparation.recordings import SplitRecordings
from flexid.identification.preparation.settings import Settings, check_against, check_for
from flexid.identification.preparation.stated import Stated, stated
from flexid.identification.structure.choice import Choice, choose_structure
from flexid.identification.structure.gap import (
    CHANCE,
    about_its_centre,
    as_wide,
    fit_with_play,
    settled,
    width_of,
)
from flexid.identification.structure.link_delay import CONFUSED, doubtful
from flexid.identification.structure.shapes import (
    SoughtShape,
    fit_requested_shapes,
    fit_with_shape,
)
from flexid.identification.structure.sought_terms import (
    HYSTERETIC,
    PRESLIDING,
    SOUGHT,
    SOUGHT_COEFFICIENTS,
    TRANSMISSION,
    is_slack,
)
from flexid.identification.structure.validation import misprediction, validate
from flexid.identification.vocabulary import Progress, silent
from flexid.identification.vocabulary.evidence import Validation
from flexid.identification.vocabulary.thresholds import THRESHOLDS, Thresholds
from flexid.models.flexible_joint import DAMPING
from flexid.recording.recording import Hold, Recording

MEASURED_HOLD: Hold = "cubic"
"""Hold of a measured position between samples, since a motion is smooth."""

_SHARE = 0.25  # part of a log that is too long for a search
_HOLDS: tuple[Hold, ...] = ("zero", "cubic", "linear")


@dataclass(frozen=True, eq=False)
class Job:
    """Task of an identification: model, data, prior knowledge and settings."""

    joint: Joint  # flexible, its link alone, or rigid
    recordings: SplitRecordings  # the data
    stated: Stated  # prior knowledge of the drive
    settings: Settings
    progress: Progress  # called with the name of each step
    thresholds: Thresholds
    left_out: frozenset[str] = frozenset()  # coefficients and delays that are not considered
    in_part: bool = False  # whether the structure is chosen from a part of the data alone

    @property
    def input_unit(self) -> str:
        """Unit of the input; empty without an input."""
        return self.recordings.recorded[0].input_unit

    @property
    def is_voltage(self) -> bool:
        """Whether the input is a voltage, or was computed from one."""
        return self.input_unit == "V" or any(own.from_voltage for own in self.recordings.recorded)

    @property
    def deflection(self) -> bool:
        """Whether the deflection was measured instead of the link's position."""
        return self.recordings.recorded[0].link_from_deflection

    @cached_property
    def training(self) -> Data:
        """Data before the held-out ends, used to choose the structure."""
        data = self._data(*self.recordings.searched)
        return data.in_part(_SHARE) if self.in_part else data

    @cached_property
    def whole(self) -> Data:
        """All data."""
        return self._data(self.recordings.whole, self.recordings.groups)

    def _data(self, recordings: Sequence[Recording], groups: Sequence[int]) -> Data:
        return data_of(self.joint, recordings, groups, self.settings.given_delay)

    @property
    def clamped(self) -> frozenset[str]:
        """Positions that are constant in every recording."""
        return frozenset.intersection(*(each.clamped for each in self.recordings.recorded))

    @property
    def link_is_clamped(self) -> bool:
        """Whether the link of a flexible joint does not move in any recording."""
        return self.joint.kind == "flexible" and "link_position" in self.clamped

    @property
    def delay_in_doubt(self) -> bool:
        """Whether a delay of the link's encoder may look like damping and friction.

        A delay of a deflection sensor does not.
        """
        settings, is_sure = self.settings, self.deflection or LINK in self.left_out
        if self.joint.kind != "link" or is_sure or settings.link_delay != "auto":
            return False
        return settings.terms == "auto" or {*CONFUSED} <= self.kept

    def fitted_by_length(self) -> FitsByLength:
        """Fit the full model to the data before the held-out ends."""
        duration = self.settings.segment_duration
        durations = () if duration == "auto" else (duration,)
        own, rest = (self.structure, self.training), (self.progress, self.thresholds)
        by_length = fit_full_model(*own, self.holds, durations, *rest, exact=self.exact)
        asked = (shape for shape in SOUGHT if not shape.coefficients.isdisjoint(self.kept))
        return fit_requested_shapes(asked, by_length)

    @cached_property
    def structure(self) -> Structure:
        """Structure with every term that is considered; its hold is not used."""
        settings = self.settings
        smooth = settings.coulomb_velocity
        joint = self.joint.scaled(self.training.samples)
        if smooth != "auto":
            joint = joint.with_coulomb_velocity(smooth)
        absent = joint.shapes if settings.terms == "auto" else joint.optional - self.kept
        absent |= joint.never
        given, bounds = self.stated.given, self.stated.bounds
        base = Structure(joint, absent, self._timing(), given, bounds)
        if joint.kind != "rigid":
            base = about_its_centre(as_wide(base, width_of(base)), self.training)
        return base.without(self.left_out | SOUGHT_COEFFICIENTS)

    @property
    def holds(self) -> Sequence[Hold]:
        """Holds of the input to choose from."""
        if self.joint.kind == "link":
            return (MEASURED_HOLD,)
        return _HOLDS if self.settings.hold == "auto" else (self.settings.hold,)

    @property
    def kept(self) -> set[str]:
        """Coefficients that always stay in the model."""
        settings = self.settings
        if settings.terms == "auto":
            return {*self.stated.kept}
        return {c for term in settings.terms for c in self.joint.terms[term]}

    @property
    def exact(self) -> bool:
        """Whether the settings require an exact fit.

        A fit with disturbances has no smoothed friction, no given segments and no given shapes.
        """
        settings = self.settings
        automatic = settings.coulomb_velocity == settings.segment_duration == "auto"
        return not (automatic and self.joint.shapes.isdisjoint(self.kept))

    def _timing(self) -> Timing:
        settings = self.settings
        asked = {}
        if self.joint.kind != "link":  # the link alone has a delay of its encoder only
            asked[INPUT] = settings.input_delay
        if self.joint.kind != "rigid":
            asked[LINK] = settings.link_delay
        given = {name: value for name, value in asked.items() if not isinstance(value, str)}
        return Timing("zero", given, tuple(name for name in asked if name not in given))


def job_of(
    recordings: SplitRecordings,
    settings: Settings,
    progress: Progress = silent,
    thresholds: Thresholds = THRESHOLDS,
) -> Job:
    """Return the job for recordings and settings; raise if they contradict each other."""
    first = recordings.recorded[0]
    joint = joint_of(_kind(first), first.joint)
    check_for(joint, settings)
    shortest = min(len(recording) * recording.sample_time for recording in recordings.recorded)
    check_against(settings, first.sample_time, shortest)
    known = stated(settings, joint, first.input_unit)
    job = Job(joint, recordings, known, settings, progress, thresholds)
    if job.link_is_clamped:
        job = replace(job, left_out=_link_coefficients(joint))
    elif joint.kind == "link" and "motor_position" in job.clamped:
        # A delay only shifts the time, and the spring's damping acts like the link's friction.
        job = replace(job, left_out=DAMPING | {LINK})
    if settings.coulomb_velocity != "auto" and (dry := sorted(job.kept & joint.shapes)):
        raise SettingError(
            "coulomb_velocity",
            f"{joint.of_coefficient(dry[0])} goes with dry friction only: leave out one of them",
        )
    return job


def _link_coefficients(joint: Joint) -> frozenset[str]:
    """Return the coefficients of terms in the link's row, which a clamped link does not show."""
    # The spring's damping is among them. With a clamped link it acts like the motor's friction.
    link = joint.systems[2].rows[0].regressors.keys()
    return frozenset(c for names in joint.terms.values() if link & {*names} for c in names)


def _kind(recording: Recording) -> Kind:
    """Return the kind of joint that the channels of a recording allow."""
    if recording.link_position is None:
        return "rigid"
    return "link" if recording.input is None else "flexible"


def predicting(job: Job) -> tuple[Choice, Validation]:
    """Return the structure from the data before the held-out ends, and its predictions of these.

    Unusual terms must improve the predictions, since a log with too little data for them is better
    described without.
    """
    if not job.delay_in_doubt:
        return _predicting(job)
    found = _predicting(replace(job, left_out=job.left_out | {LINK}))
    impossible = doubtful(found[0].fitted.by_name) - job.kept
    return _predicting(replace(job, left_out=impossible)) if impossible else found


def _predicting(job: Job) -> tuple[Choice, Validation]:
    thresholds = job.thresholds
    by_length = job.fitted_by_length()
    left = turning(by_length.found, thresholds)
    auto = job.settings.terms == "auto"
    if auto and left is not None and left.unexplained_over(TURNING) > thresholds.shape_motion:
        raise ConvergenceError(
            "prediction error",
            f"the model leaves {100.0 * left.unexplained:.0f} % of the deflection unexplained over "
            f"{left.duration:.2g} s: look for other effects that move it",
        )
    choice, validation = _chosen(job, by_length, with_shapes=auto)
    if not auto:
        return choice, validation
    if not choice.structure.joint.shapes <= choice.structure.absent:
        job.progress("the usual terms alone as a rival")
        rival, other = _chosen(job, by_length, with_shapes=False)
        leaner = len(choice.fitted.names) < len(rival.fitted.names)
        allowed = thresholds.generous_gain if leaner else 0.0  # a leaner model is preferred
        if misprediction(validation) >= misprediction(other) + allowed:
            choice, validation = rival, other
    alike = (one for one in SOUGHT if not one.looks_like.isdisjoint(choice.fitted.names))
    for shape in [*alike] if explains(choice.fitted, thresholds) else []:
        choice, validation = _unless_likelier(shape, choice, validation, job)
    tried: FitsByLength | None = None
    while choice.by_length is not tried and not explains(choice.fitted, thresholds):
        tried = choice.by_length
        for find in _further_searches(choice, job):
            if (found := find(choice)) is None:
                continue
            # A search that has succeeded is completed.
            with renewed() if explains(found.found[-1], thresholds) else nullcontext():
                rival, its = _chosen(job, found, with_shapes=True)
            saved = misprediction(validation) - misprediction(its)
            if saved > _least_gain(rival.fitted.excess, choice.fitted.excess, thresholds):
                choice, validation = rival, its
                if explains(choice.fitted, thresholds):
                    return choice, validation
    return choice, validation


def _chosen(job: Job, by_length: FitsByLength, *, with_shapes: bool) -> tuple[Choice, Validation]:
    """Return the structure of a full model that the log shows, or a better rival, and its fit."""
    choice = choose_structure(by_length, job.kept, with_shapes=with_shapes)
    job.progress("predicting the held-out data")
    return _preferred(choice, job)


def _unless_likelier(
    shape: SoughtShape, choice: Choice, validation: Validation, job: Job
) -> tuple[Choice, Validation]:
    """Return the choice, or the likelier one with a term that the chosen one looks like."""
    # Both may leave no more than noise, so that neither predicts better.
    with suppress(ConvergenceError):
        found = fit_requested_shapes([shape], choice.by_length)
        rival, its = _chosen(job, found, with_shapes=True)
        fall = choice.fitted.excess - rival.fitted.excess
        is_likelier = fall * choice.fitted.problem.degrees_of_freedom > CHANCE
        # Shorter segments leave less with any term.
        as_long = rival.fitted.duration >= choice.fitted.duration
        lost = misprediction(its) - misprediction(validation)
        fair = as_long and lost <= job.thresholds.generous_gain
        if is_likelier and fair and shape.is_in(rival.fitted) and shape.is_possible(rival.fitted):
            return rival, its
    return choice, validation


def _further_searches(
    choice: Choice, job: Job
) -> Iterator[Callable[[Choice], FitsByLength | None]]:
    """Yield searches for further terms, each a function of the choice so far."""
    by_length = choice.by_length
    full = by_length.found[-1]
    before = turning(by_length.found, job.thresholds)
    late = []
    if before is not None and before.unexplained_over(TURNING) <= job.thresholds.shape_motion:
        for shape in (shape for shape in (HYSTERETIC, *SOUGHT) if not shape.is_in(full)):
            search = partial(_with_shape, shape, by_length, before, job)
            if shape in (TRANSMISSION, PRESLIDING):  # play is more common
                late.append(search)
            else:
                yield search
    yield lambda chosen: _with_play(by_length, chosen, job)
    yield from late


def _with_shape(
    shape: SoughtShape, by_length: FitsByLength, before: Fitted, job: Job, chosen: Choice
) -> FitsByLength | None:
    """Return fits with a shape whose constant is sought; None if play is the leaner explanation."""
    found = fit_with_shape(shape, by_length, before, chosen.by_length.found, job.kept)
    return None if found is None or is_slack(found.found[-1]) else found


def _least_gain(rival: float, chosen: float, thresholds: Thresholds) -> float:
    """Return the least fall of the held-out errors for a rival, from the excess of both."""
    # It is zero if only the rival explains the log.
    explains = rival <= thresholds.sensor_excess < chosen
    return 0.0 if explains else thresholds.generous_gain


def _with_play(by_length: FitsByLength, chosen: Choice, job: Job) -> FitsByLength | None:
    """Return fits with play; None if the choice so far explains the log, or play does not help."""
    if chosen.fitted.excess <= job.thresholds.sensor_excess:
        return None
    return fit_with_play(by_length, chosen.by_length.found)


def _preferred(choice: Choice, job: Job) -> tuple[Choice, Validation]:
    """Return the chosen structure, or one of its rivals that predicts far better."""
    starts = job.recordings.starts
    chosen = validate(choice.fitted, job.whole, starts)
    limit = misprediction(chosen) - job.thresholds.generous_gain
    best = choice
    for rival in choice.rivals:
        if misprediction(validate(rival, job.whole, starts)) >= limit:
            continue
        rival = settled(rival)
        other = validate(rival, job.whole, starts)
        if misprediction(other) < limit:
            limit, chosen = misprediction(other), other
            full = replace(choice.full, joint=rival.structure.joint)
            best = replace(choice, full=full, structure=rival.structure, fitted=rival)
    return best, chosen
