"""From logs to what they can tell: the work of ``flexid excitation``."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

import flexid
from flexid.analysis.excitation import LOST_CONDITION
from flexid.analysis.information import Information, segmented_information
from flexid.design.advice import Advice, Rehearsal, advise, input_spectrum, rule_of_thumb
from flexid.design.assessment import Assessment, assess
from flexid.errors import ConvergenceError, RecordingError, SettingError
from flexid.estimators.filter_rate import choose_filter_rate
from flexid.estimators.prediction_error import PredictionErrorFit, prediction_error
from flexid.estimators.samples import FloatArray, Samples, samples_of_recording
from flexid.estimators.segments import FEWEST_SAMPLES, divide, first_states
from flexid.estimators.state_variable_filter import LeastSquaresFit, filtered_least_squares
from flexid.identification.preparation import check_distinct, common_input_unit
from flexid.identification.settings import Settings
from flexid.models.flexible_joint import PAPER_TERMS, flexible_joint
from flexid.models.parametric_system import ParametricSystem
from flexid.recording.recording import Log
from flexid.recording.velocities import position_noise, with_velocities

SEGMENT_DURATION = 1.0
"""Length in s of the segments of the prediction; the bound is that of such a fit."""

_FINEST = 1e-9  # noise over the largest position that is still told from none
_SAME = 1e-6  # relative change of the start that is no other start
_NOISE_EXCESS = 1.5  # residual over sensor noise that deserves a warning


@dataclass(frozen=True)
class ExcitationReport:
    """What logs can tell about a joint.

    Parameters
    ----------
    assessment : Assessment
        Per coefficient and row.
    advice : Advice or None
        What to add; None where every coefficient can be told as it is.
    information : Information
        What the positions tell.
    noise : mapping of str to float
        Standard deviation in rad of what is taken for noise of link_position and motor_position.
    spectrum : array, shape (2, m)
        Angular frequency in rad/s and amplitude of the input's tones, longest piece.
    input_unit : str
        Unit of the input.
    hold : str
        Behaviour of the input between samples.
    filter_rate : float
        Rate in 1/s of the filter behind the rows' excitation.
    warnings : tuple of str
        What limits the prediction.
    provenance : mapping
        Version, settings, inputs with their hashes.
    """

    assessment: Assessment
    advice: Advice | None
    information: Information
    noise: Mapping[str, float]
    spectrum: FloatArray
    input_unit: str
    hold: str
    filter_rate: float
    warnings: tuple[str, ...]
    provenance: Mapping[str, object]

    @property
    def supported(self) -> bool:
        """Whether every coefficient can be told, be it weakly."""
        return self.assessment.status != "undetermined"


def examine(logs: Sequence[Log], settings: Settings) -> ExcitationReport:
    """Say how well logs tell each coefficient, and what to add where they do not.

    Parameters
    ----------
    logs : sequence of Log
        Of the same drive, with the same kind of input.
    settings : Settings
        Terms (the paper's if they are left to be chosen), what is known, and the hold; the others
        do not matter here.

    Returns
    -------
    ExcitationReport

    Raises
    ------
    RecordingError
        If the logs do not go together or are too short.
    SettingError
        If a setting does not suit the logs.
    """
    if any(settings.known_deviations.values()):
        raise SettingError(
            "known", "what is known counts as exact here: give it without an uncertainty"
        )
    check_distinct(logs)
    unit = common_input_unit(logs)
    terms = PAPER_TERMS if settings.terms == "auto" else settings.terms
    system = flexible_joint(terms, settings.fixed_coefficients(input_is_torque=unit == "N m"))
    pieces = [
        samples_of_recording(with_velocities(piece))
        for log in logs
        for piece in log.pieces
        if len(piece) >= FEWEST_SAMPLES
    ]
    if not pieces:
        raise RecordingError(
            logs[0].source, "", f"has fewer than {FEWEST_SAMPLES} samples in a row: record longer"
        )
    fit = _least_squares(pieces, system, settings)
    information, noise, warnings, converged = _information(pieces, system, fit)
    assessment = assess(information, fit, unit)
    if not converged:
        assessment = assessment.without_lost()
    advice = None
    if assessment.status == "undetermined" and not converged:
        advice = rule_of_thumb(pieces)
    elif assessment.status != "determined":
        rehearsal = Rehearsal(
            system, information.values, noise, fit.hold, fit.filter_rate, SEGMENT_DURATION, unit
        )
        advice = advise(rehearsal, pieces)
    return ExcitationReport(
        assessment,
        advice,
        information,
        dict(zip(("link_position", "motor_position"), map(float, noise), strict=True)),
        input_spectrum(max(pieces, key=len)),
        unit,
        fit.hold,
        fit.filter_rate,
        (*(warning for log in logs for warning in log.warnings), *warnings),
        {
            "flexid_version": flexid.__version__,
            "terms": list(terms),
            "known": dict(settings.known),
            "segment_duration": SEGMENT_DURATION,
            "inputs": [{"file": log.source, "sha256": log.sha256} for log in logs],
        },
    )


def _least_squares(
    pieces: Sequence[Samples], system: ParametricSystem, settings: Settings
) -> LeastSquaresFit:
    """Fit with the hold that suits the log better, both at the same filter rate."""
    hold = "zero" if settings.hold == "zero" else "linear"
    rate = choose_filter_rate(pieces, system, hold)
    fit = filtered_least_squares(pieces, system, rate, hold)
    if settings.hold != "auto":
        return fit
    return min(fit, filtered_least_squares(pieces, system, rate, "zero"), key=_misfit)


def _misfit(fit: LeastSquaresFit) -> float:
    return sum(row.residual_sum / row.total_sum for row in fit.rows)


def _information(
    pieces: Sequence[Samples], system: ParametricSystem, fit: LeastSquaresFit
) -> tuple[Information, FloatArray, tuple[str, ...], bool]:
    """Information at the best values that can be had, with the noise of the log itself.

    Returns
    -------
    information : Information
    noise : array, shape (n_rows,)
    warnings : tuple of str
    converged : bool
        Whether the values are those of prediction error; if not, those of least squares.
    """
    bare = [replace(piece, velocities=None) for piece in pieces]
    segments = divide(bare, SEGMENT_DURATION)
    sensor = np.maximum(
        [position_noise(column) for column in segments.outputs.T],
        _FINEST * np.abs(segments.outputs).max(),
    )
    warnings: tuple[str, ...] = ()
    converged = True
    try:
        found = prediction_error(bare, system, fit, SEGMENT_DURATION, fit.hold)
        _confirm(found, bare, system, fit)
        values, states = found.values, found.initial_states
        noise = np.maximum(found.noise, sensor)
        excess = float((noise / sensor).max())
        if excess > _NOISE_EXCESS:
            warnings = (
                f"the model leaves {excess:.1f} times what the sensors' noise explains: a term is "
                f"missing, or the input as recorded is not what acted; the prediction takes it for "
                f"noise",
            )
    except ConvergenceError:
        converged = False
        values, states, noise = fit.values, first_states(segments), sensor
        warnings = (
            "prediction error does not settle on this log, so the prediction is made at the values "
            "of least squares, with the sensors' noise alone: take it for an order of magnitude",
        )
    information = segmented_information(system, values, segments, states, noise, fit.hold)
    return information, noise, warnings, converged


def _confirm(
    found: PredictionErrorFit,
    pieces: Sequence[Samples],
    system: ParametricSystem,
    fit: LeastSquaresFit,
) -> None:
    """Fit again from elsewhere along directions that are lost: a flat valley has no bottom.

    Raises
    ------
    ConvergenceError
        If the second fit does not end where the first one did.
    """
    start = fit.values.copy()
    for row, (_, part) in zip(fit.rows, system.row_slices(), strict=True):
        scale = np.sqrt(np.diag(row.gram))
        scale = np.where(scale > 0.0, scale, 1.0)
        gram = row.gram / np.outer(scale, scale)
        seen = np.linalg.pinv(gram, rcond=1.0 / LOST_CONDITION, hermitian=True) @ gram
        start[part] = seen @ (fit.values[part] * scale) / scale
    if np.allclose(start, fit.values, rtol=_SAME):
        return
    again = prediction_error(
        pieces,
        system,
        dict(zip(system.coefficients, start.tolist(), strict=True)),
        SEGMENT_DURATION,
        fit.hold,
    )
    deviations = np.sqrt(np.diag(found.gauss_newton_covariance))
    if np.any(np.abs(again.values - found.values) > deviations):
        raise ConvergenceError("prediction error", "it ends elsewhere from another start")
