"""From logs to what they determine: the work of ``flexid excitation``.

The question is that of `identify`, and so is the answer: the logs are identified, with the terms,
delays and noise that they show. What comes on top is what confuses the coefficients, and which
input would distinguish them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from flexid.arrays import FloatArray
from flexid.experiment_design.advice import Advice, advise, beginning, input_spectrum
from flexid.experiment_design.assessment import Assessment, assess
from flexid.experiment_design.rehearsal import Rehearsal
from flexid.identification.full_model.model import Data, data_of
from flexid.identification.identify import identify
from flexid.identification.preparation.joint import joint_of
from flexid.identification.preparation.recordings import prepare
from flexid.identification.preparation.settings import Settings
from flexid.identification.result.identification import Identification
from flexid.identification.vocabulary.progress import Progress, silent
from flexid.recording.recording import Log
from flexid.stored_estimates.rebuilt import described, given_coefficients, rebuilt


@dataclass(frozen=True)
class ExcitationReport:
    """What logs determine of a joint."""

    identification: Identification
    assessment: Assessment
    advice: Advice | None  # None where every coefficient is determined
    noise: Mapping[str, float]  # rad, root mean square of each position's residuals
    spectrum: FloatArray  # (2, m): rad/s and amplitudes of the input's tones, longest recording
    input_unit: str


def examine(
    logs: Sequence[Log], settings: Settings, progress: Progress = silent
) -> ExcitationReport:
    """Say how well logs determine each coefficient, and what to add where they do not."""
    return look_into(identify(logs, settings, progress), logs, settings, progress)


def look_into(
    result: Identification, logs: Sequence[Log], settings: Settings, progress: Progress = silent
) -> ExcitationReport:
    """Say the same of logs that are identified already."""
    recordings, _ = prepare(logs, settings.validation_share, settings.model)
    recordings = result.choices.amplifier.split_behind(recordings)
    joint = joint_of(result.model)
    data = data_of(joint, recordings.whole, recordings.groups)
    noise = data.noise * np.array(list(result.residual_excess.values()))
    progress("what to add")
    advice = advise(result, data.samples, lambda: _rehearsal(result, data, noise))
    return ExcitationReport(
        result,
        assess(result),
        advice,
        dict(zip(result.residual_excess, noise.tolist(), strict=True)),
        input_spectrum(max(data.samples, key=len)),
        "rad" if result.model == "link" else recordings.recorded[0].input_unit,
    )


def _rehearsal(result: Identification, data: Data, noise: FloatArray) -> Rehearsal:
    longest = max(range(len(data.samples)), key=lambda recording: len(data.samples[recording]))
    group = data.groups[longest]
    model = rebuilt(described(result, group), given_coefficients(result))
    return Rehearsal(model, result, beginning(data.samples[longest]), group, noise, data)
