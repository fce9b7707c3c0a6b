"""What the logs and the settings leave to be found, and the structure that predicts best."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

from flexid.errors import ConvergenceError, SettingError
from flexid.estimators.channel_timing import INPUT, Timing
from flexid.identification.full_model.fits_by_length import (
    TURNING,
    FitsByLength,
    fit_full_model,
    fit_with_hysteresis,
    turning,
)
from flexid.identification.full_model.model import LINK, Data, Fitted, Structure
from flexid.identification.preparation.joint import Joint, Kind, joint_of
from flexid.identification.preparation.recordings import SplitRecordings
from flexid.identification.preparation.settings import Settings, check_against, check_for
from flexid.identification.preparation.stated import Stated, stated
from flexid.identification.structure.bend import is_slack
from flexid.identification.structure.elimination import Choice, choose_structure
from flexid.identification.structure.gap import fit_with_play
from flexid.identification.structure.link_delay import CONFUSED, doubtful
from flexid.identification.structure.shapes import SOUGHT, SOUGHT_COEFFICIENTS
from flexid.identification.structure.sought_shape import (
    SoughtShape,
    fit_requested_shape,
    fit_with_shape,
)
from flexid.identification.structure.validation import misprediction, validate
from flexid.identification.vocabulary.evidence import Validation
from flexid.identification.vocabulary.progress import Progress
from flexid.identification.vocabulary.thresholds import Thresholds
from flexid.recording.recording import Hold, Recording

MEASURED_HOLD: Hold = "cubic"
"""How a measured position runs between samples: no motion has corners."""

_HOLDS: tuple[Hold, ...] = ("zero", "cubic", "linear")


@dataclass(frozen=True)
class Job:
    """What the logs and the settings leave to be found."""

    joint: Joint  # flexible, its link alone, or rigid
    input_unit: str  # of the input; empty where there is none
    stated: Stated  # what the user states of the drive
    settings: Settings  # what the user decides
    deflection: bool = False  # whether the deflection was measured instead of the link's position
    left_out: frozenset[str] = frozenset()  # coefficients and delays that are not considered

    @property
    def delay_in_doubt(self) -> bool:
        """Whether a delay of the link's encoder may pass for damping and friction.

        That of a deflection's sensor cannot.
        """
        settings = self.settings
        if self.joint.kind != "link" or self.deflection or settings.link_delay != "auto":
            return False
        return settings.terms == "auto" or {*CONFUSED} <= self.kept

    def fitted_by_length(
        self, training: Data, progress: Progress, thresholds: Thresholds
    ) -> FitsByLength:
        """The full model, fitted to some data."""
        base, settings = self.structure(training), self.settings
        duration = settings.segment_duration
        durations = () if duration == "auto" else (duration,)
        by_length = fit_full_model(
            base, training, self.holds, durations, progress, thresholds, insist=not self.exact
        )
        for shape in SOUGHT:
            if not shape.coefficients.isdisjoint(self.kept):
                by_length = fit_requested_shape(shape, by_length, progress, thresholds)
        return by_length

    def structure(self, data: Data) -> Structure:
        """Every term that is to be considered; its hold is of no account."""
        settings = self.settings
        smooth = settings.coulomb_velocity
        joint = self.joint.scaled(data.samples)
        if smooth != "auto":
            joint = joint.with_coulomb_velocity(smooth)
        absent = joint.shapes if settings.terms == "auto" else joint.optional - self.kept
        given, bounds = self.stated.given, self.stated.bounds
        base = Structure(joint, frozenset(absent), self._timing(), given, bounds)
        return base.without(self.left_out | SOUGHT_COEFFICIENTS)

    @property
    def holds(self) -> Sequence[Hold]:
        """Behaviours of the input to choose from."""
        if self.joint.kind == "link":
            return (MEASURED_HOLD,)
        return _HOLDS if self.settings.hold == "auto" else (self.settings.hold,)

    @property
    def kept(self) -> set[str]:
        """Coefficients that stay in the model whatever the log says."""
        settings = self.settings
        if settings.terms == "auto":
            return {*self.stated.kept}
        return {c for term in settings.terms for c in self.joint.terms[term]}

    @property
    def exact(self) -> bool:
        """Whether no fit with disturbances is asked for.

        Innovations know neither smoothed friction, nor segments, nor terms with a shape.
        """
        settings = self.settings
        automatic = settings.coulomb_velocity == settings.segment_duration == "auto"
        return not (automatic and self.joint.shapes.isdisjoint(self.kept))

    def _timing(self) -> Timing:
        settings = self.settings
        asked = {}
        if self.joint.kind != "link":  # which knows time only against its encoder
            asked[INPUT] = settings.input_delay
        if self.joint.kind != "rigid":
            asked[LINK] = settings.link_delay
        given = {name: value for name, value in asked.items() if not isinstance(value, str)}
        return Timing("zero", given, tuple(name for name in asked if name not in given))


def job_of(recordings: SplitRecordings, settings: Settings) -> Job:
    """What is to be found in some recordings."""
    input_unit = recordings.recorded[0].input_unit
    joint = joint_of(_kind(recordings.recorded[0]))
    check_for(joint, settings)
    shortest = min(len(recording) * recording.sample_time for recording in recordings.recorded)
    check_against(settings, recordings.recorded[0].sample_time, shortest)
    deflection = recordings.recorded[0].link_from_deflection
    job = Job(joint, input_unit, stated(settings, joint, input_unit), settings, deflection)
    if settings.coulomb_velocity != "auto" and (dry := sorted(job.kept & joint.shapes)):
        raise SettingError(
            "coulomb-velocity",
            f"{joint.of_coefficient(dry[0])} goes with dry friction only: leave one of them",
        )
    return job


def _kind(recording: Recording) -> Kind:
    """What can be identified from the channels of a recording."""
    if recording.link_position is None:
        return "rigid"
    return "link" if recording.input is None else "flexible"


def predicting(
    job: Job,
    training: Data,
    whole: Data,
    recordings: SplitRecordings,
    progress: Progress,
    thresholds: Thresholds,
) -> tuple[Choice, Validation]:
    """The structure that the data before the held-out ends show, and how it predicts these.

    Terms beyond the usual ones have to pay there: a rig with too little data for them is better
    described without.
    """
    rest = (training, whole, recordings, progress, thresholds)
    if not job.delay_in_doubt:
        return _in_time(job, _predicting(job, *rest), *rest)
    found = _predicting(replace(job, left_out=job.left_out | {LINK}), *rest)
    impossible = doubtful(found[0].fitted.by_name) - job.kept
    return _predicting(replace(job, left_out=impossible), *rest) if impossible else found


def _in_time(
    job: Job,
    found: tuple[Choice, Validation],
    training: Data,
    whole: Data,
    recordings: SplitRecordings,
    progress: Progress,
    thresholds: Thresholds,
) -> tuple[Choice, Validation]:
    """What was found of the link alone, or the same without a delay if it predicts far better.

    A late encoder acts like damping; together they may fit what no term describes, and drift away
    in a free run.
    """
    fitted = found[0].fitted
    explained = fitted.excess <= thresholds.sensor_excess
    if job.joint.kind != "link" or LINK not in fitted.structure.timing.sought or explained:
        return found
    timely = replace(job, left_out=job.left_out | {LINK})
    other = _predicting(timely, training, whole, recordings, progress, thresholds)
    better = misprediction(other[1]) < misprediction(found[1]) - thresholds.generous_gain
    return other if better else found


def _predicting(
    job: Job,
    training: Data,
    whole: Data,
    recordings: SplitRecordings,
    progress: Progress,
    thresholds: Thresholds,
) -> tuple[Choice, Validation]:
    by_length = job.fitted_by_length(training, progress, thresholds)
    left = turning(by_length.found, thresholds)
    auto = job.settings.terms == "auto"
    if auto and left is not None and left.unexplained_over(TURNING) > thresholds.shape_motion:
        raise ConvergenceError(
            "prediction error",
            f"the model leaves {100.0 * left.unexplained:.0f} % of the deflection unexplained over "
            f"{left.duration:.2g} s: look for what else moves the joint",
        )
    choose = partial(
        choose_structure, kept=job.kept, progress=progress, thresholds=thresholds, insist=job.exact
    )
    choice = choose(by_length, with_shapes=auto)
    progress("predicting the held-out data")
    choice, validation = _preferred(choice, whole, recordings, thresholds)
    if not auto:
        return choice, validation
    if not choice.structure.joint.shapes <= choice.structure.absent:
        progress("the usual terms alone as a rival")
        rival = choose(by_length, with_shapes=False)
        rival, other = _preferred(rival, whole, recordings, thresholds)
        leaner = len(choice.fitted.names) < len(rival.fitted.names)
        allowed = thresholds.generous_gain if leaner else 0.0  # what is leaner has paid already
        if misprediction(validation) >= misprediction(other) + allowed:
            choice, validation = rival, other
    tried: FitsByLength | None = None
    while choice.by_length is not tried and not _explains(choice.fitted, thresholds):
        tried = choice.by_length
        for find in _beside(choice, progress, thresholds):
            if (other := find(choice)) is None:
                continue
            rival = choose(other, with_shapes=True)
            rival, its = _preferred(rival, whole, recordings, thresholds)
            saved = misprediction(validation) - misprediction(its)
            if saved > _least_gain(rival.fitted.excess, choice.fitted.excess, thresholds):
                choice, validation = rival, its
                if _explains(choice.fitted, thresholds):
                    return choice, validation
    return choice, validation


def _explains(fitted: Fitted, thresholds: Thresholds) -> bool:
    """Whether nothing is left to explain over segments in which most springs turn round."""
    return fitted.excess <= thresholds.sensor_excess and fitted.duration >= TURNING


def _beside(
    choice: Choice, progress: Progress, thresholds: Thresholds
) -> Iterator[Callable[[Choice], FitsByLength | None]]:
    """What to try where a choice leaves more than noise, each given what is chosen so far."""
    by_length = choice.by_length
    full = by_length.found[-1]
    before = turning(by_length.found, thresholds)
    if before is not None and before.unexplained_over(TURNING) <= thresholds.shape_motion:
        if full.structure.joint.remembered <= full.structure.absent:
            yield lambda _: fit_with_hysteresis(by_length, before, progress, thresholds)
        for shape in SOUGHT:
            if not shape.is_in(full):
                yield partial(_seeking, shape, by_length, before, progress, thresholds)
    yield lambda chosen: _gapped(by_length, chosen, progress, thresholds)


def _seeking(
    shape: SoughtShape,
    by_length: FitsByLength,
    before: Fitted,
    progress: Progress,
    thresholds: Thresholds,
    chosen: Choice,
) -> FitsByLength | None:
    """Fits with a shape whose constant is sought, unless it stands for play, a leaner term."""
    found = fit_with_shape(shape, by_length, before, chosen.by_length.found, progress, thresholds)
    return None if found is None or is_slack(found.found[-1]) else found


def _least_gain(rival: float, chosen: float, thresholds: Thresholds) -> float:
    """What a rival has to save of the held-out data's errors, from the excess of both.

    What explains the log where the other does not has paid for itself already.
    """
    explains = rival <= thresholds.sensor_excess < chosen
    return 0.0 if explains else thresholds.generous_gain


def _gapped(
    by_length: FitsByLength, chosen: Choice, progress: Progress, thresholds: Thresholds
) -> FitsByLength | None:
    """Fits with play, where what was chosen does not explain the log."""
    if chosen.fitted.excess <= thresholds.sensor_excess:
        return None
    return fit_with_play(by_length, chosen.by_length.found, progress, thresholds)


def _preferred(
    choice: Choice, whole: Data, recordings: SplitRecordings, thresholds: Thresholds
) -> tuple[Choice, Validation]:
    """The structure as it was chosen, or a rival of it that predicts far better."""
    chosen = validate(choice.fitted, whole, recordings.starts)
    limit = misprediction(chosen) - thresholds.generous_gain
    best = choice
    for rival in choice.rivals:
        other = validate(rival, whole, recordings.starts)
        if misprediction(other) < limit:
            limit, chosen = misprediction(other), other
            full = replace(choice.full, joint=rival.structure.joint)
            best = replace(choice, full=full, structure=rival.structure, fitted=rival)
    return best, chosen
