"""What the logs and the settings leave to be found, and the structure that predicts best."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from flexid.estimators.segmented_motion import INPUT, Timing
from flexid.identification.full_model import LINK, Data, Structure
from flexid.identification.joint import Joint, flexible, rigid
from flexid.identification.judgement import Thresholds
from flexid.identification.preparation import Pieces
from flexid.identification.progress import Progress
from flexid.identification.result import (
    Validation,
)
from flexid.identification.settings import Settings, check_for
from flexid.identification.stated import Stated, stated
from flexid.identification.structure import Choice, choose_structure
from flexid.identification.validation import misprediction, validate
from flexid.recording.recording import Hold

_HOLDS: tuple[Hold, ...] = ("zero", "cubic", "linear")


@dataclass(frozen=True)
class Job:
    """What the logs and the settings leave to be found.

    Parameters
    ----------
    joint : Joint
        Flexible or rigid.
    input_unit : str
        Of the input.
    stated : Stated
        What the user states of the drive.
    settings : Settings
        What the user decides.
    """

    joint: Joint
    input_unit: str
    stated: Stated
    settings: Settings

    def chosen(
        self,
        training: Data,
        progress: Progress,
        thresholds: Thresholds,
        rival_of: Choice | None = None,
    ) -> Choice:
        """The structure that some data show; as a rival of another, without its unusual terms."""
        settings = self.settings
        holds: Sequence[Hold] = _HOLDS if settings.hold == "auto" else (settings.hold,)
        if rival_of is not None:
            holds = (rival_of.structure.timing.hold,)
        smooth = settings.coulomb_velocity
        joint = self.joint.scaled(training.samples)
        if smooth != "auto":
            joint = joint.with_coulomb_velocity(smooth)
        if settings.terms == "auto":
            absent = joint.shapes
            stay = self.stated.kept
        else:
            on = {c for term in settings.terms for c in joint.terms[term]}
            absent = joint.optional - on
            stay = on
        given, bounds = self.stated.given, self.stated.bounds
        base = Structure(joint, frozenset(absent), self._timing(), given, bounds)
        duration = settings.segment_duration
        return choose_structure(
            base,
            training,
            holds,
            stay,
            settings.terms == "auto" and rival_of is None,
            () if duration == "auto" else (duration,),
            progress,
            thresholds,
        )

    def _timing(self) -> Timing:
        settings = self.settings
        asked = {INPUT: settings.input_delay}
        if self.joint.kind == "flexible":
            asked[LINK] = settings.link_delay
        given = {name: value for name, value in asked.items() if not isinstance(value, str)}
        return Timing("zero", given, tuple(name for name in asked if name not in given))


def job_of(pieces: Pieces, settings: Settings) -> Job:
    """What is to be found in some pieces.

    Raises
    ------
    SettingError
        If a setting does not suit the joint.
    """
    input_unit = pieces.recorded[0].input_unit
    joint = rigid() if pieces.recorded[0].link_position is None else flexible()
    check_for(joint, settings)
    return Job(joint, input_unit, stated(settings, joint, input_unit), settings)


def predicting(
    job: Job,
    training: Data,
    whole: Data,
    pieces: Pieces,
    progress: Progress,
    thresholds: Thresholds,
) -> tuple[Choice, Validation]:
    """The structure that the data before the held-out ends show, and how it predicts these.

    Terms beyond the usual ones have to pay there: a rig with too little data for them is better
    described without.
    """
    choice = job.chosen(training, progress, thresholds)
    progress("predicting the held-out data")
    choice, validation = _preferred(choice, whole, pieces, thresholds)
    if job.settings.terms != "auto" or choice.structure.joint.shapes <= choice.structure.absent:
        return choice, validation
    progress("the usual terms alone as a rival")
    rival = job.chosen(training, progress, thresholds, choice)
    rival, other = _preferred(rival, whole, pieces, thresholds)
    if misprediction(validation) < misprediction(other):
        return choice, validation
    return replace(rival, hold_reason=choice.hold_reason), other


def _preferred(
    choice: Choice, whole: Data, pieces: Pieces, thresholds: Thresholds
) -> tuple[Choice, Validation]:
    """The structure as it was chosen, or a rival of it that predicts far better."""
    chosen = validate(choice.fitted, whole, pieces.starts)
    limit = misprediction(chosen) - thresholds.generous_gain
    best = choice
    for rival in choice.rivals:
        other = validate(rival, whole, pieces.starts)
        if misprediction(other) < limit:
            limit, chosen = misprediction(other), other
            best = replace(choice, structure=rival.structure, fitted=rival)
    return best, chosen
