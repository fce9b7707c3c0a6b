"""The main job: logs and a model become an estimate with intervals and a verdict."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np

import flexid
from flexid.analysis.excitation import Excitation, excitation_of_gram
from flexid.errors import RecordingError, SettingError
from flexid.estimators.filter_rate import choose_filter_rate
from flexid.estimators.samples import samples_of_recording
from flexid.estimators.state_variable_filter import LeastSquaresFit, filtered_least_squares
from flexid.identification.estimates import (
    coefficient_estimates,
    filter_shifts,
    parameter_estimates,
)
from flexid.identification.observer_stream import stream
from flexid.identification.residuals import residual_excess
from flexid.identification.result import Identification
from flexid.identification.settings import Settings
from flexid.identification.validation import validate
from flexid.identification.warnings import residual_warnings, sign_warnings, validation_warnings
from flexid.models.flexible_joint import flexible_joint
from flexid.models.parametric_system import ParametricSystem
from flexid.recording.recording import Hold, Log, Recording
from flexid.recording.velocities import with_velocities

_FEWEST_TRAINING_SAMPLES = 50
_FEWEST_HELD_OUT_SAMPLES = 10
# Other filter rates at which a right model gives the same answer. Slower ones see another part of
# the motion and hardly any noise; beyond twice the rate noise in the regressors biases the answer.
_RATE_FACTORS = (0.125, 0.25, 0.5, 2.0)


@dataclass(frozen=True)
class _Fitter:
    """Least squares with the choices made once, on the training data."""

    system: ParametricSystem
    filter_rate: float
    hold: Hold

    def at(self, filter_rate: float) -> "_Fitter":
        return replace(self, filter_rate=filter_rate)

    def fit(self, pieces: Sequence[Recording]) -> LeastSquaresFit:
        samples = [samples_of_recording(piece) for piece in pieces]
        return filtered_least_squares(
            samples, self.system, filter_rate=self.filter_rate, hold=self.hold
        )


def identify(logs: Sequence[Log], settings: Settings | None = None) -> Identification:
    """Identify a flexible joint from one or several logs.

    State-variable-filter least squares on positions gives the coefficients, once from the data
    before the held-out end of each piece, for the validation by free run, and once from all data,
    for the report. The paper's observer runs over the same logs as a stream.

    Parameters
    ----------
    logs : sequence of Log
        Of the same drive, with the same kind of input.
    settings : Settings, optional
        Choices; see there.

    Returns
    -------
    Identification

    Raises
    ------
    RecordingError
        If the logs do not go together or are too short.
    SettingError
        If a setting does not suit the logs.
    """
    settings = settings or Settings()
    _check_distinct(logs)
    input_unit = _common_input_unit(logs)
    known = settings.known_coefficients(input_is_torque=input_unit == "N m")
    system = flexible_joint(settings.terms, known)
    measured, dropped = _long_enough(logs, settings.validation_share)
    starts = [_held_out_start(piece, settings.validation_share) for piece in measured]
    parts = [piece.window(0, start) for piece, start in zip(measured, starts, strict=True)]
    # Derived apart, so that no velocity of the training data knows of the held-out positions.
    training = [with_velocities(part) for part in parts]
    pieces = [with_velocities(piece) for piece in measured]
    fitter = _choose(training, system, settings)

    trained = fitter.fit(training)
    values = dict(zip(trained.names, map(float, trained.values), strict=True))
    validation = validate(list(zip(pieces, starts, strict=True)), system, values, fitter.hold)

    fit = fitter.fit(pieces)
    excitation = _excitation(fit)
    others = [fitter.at(factor * fitter.filter_rate).fit(pieces) for factor in _RATE_FACTORS]
    excess = residual_excess(fit, pieces, system)
    coefficients = coefficient_estimates(
        fit,
        filter_shifts(fit, others),
        excess,
        excitation,
        validation.fit_percent,
        known,
        input_unit,
    )
    return Identification(
        coefficients=coefficients,
        parameters=parameter_estimates(fit, coefficients, input_unit),
        excitation=excitation,
        residual_excess=excess,
        validation=validation,
        observer=stream(pieces, system, fitter.hold),
        hold=fitter.hold,
        filter_rate=fitter.filter_rate,
        warnings=(
            *(warning for log in logs for warning in log.warnings),
            *dropped,
            *sign_warnings(coefficients),
            *residual_warnings(excess),
            *validation_warnings(validation.fit_percent),
        ),
        provenance=_provenance(logs, settings, fitter),
    )


def _check_distinct(logs: Sequence[Log]) -> None:
    """Refuse the same data twice: counted as independent, they would narrow every interval."""
    sources: dict[str, str] = {}
    for log in logs:
        if log.sha256 and log.sha256 in sources:
            raise RecordingError(
                log.source, "", f"holds the same data as {sources[log.sha256]}: give it only once"
            )
        sources[log.sha256] = log.source


def _common_input_unit(logs: Sequence[Log]) -> str:
    units = {piece.input_unit: log.source for log in logs for piece in log.pieces}
    if len(units) > 1:
        (first, second), sources = list(units)[:2], list(units.values())
        raise RecordingError(
            sources[1],
            "input",
            f"is in {second} where {sources[0]} has {first}: identify them one by one",
        )
    return next(iter(units))


def _long_enough(logs: Sequence[Log], share: float) -> tuple[list[Recording], list[str]]:
    """Pieces that leave enough to fit, all if none does, and a warning for each of the others."""
    pieces = [piece for log in logs for piece in log.pieces]
    kept = [p for p in pieces if round(len(p) * (1 - share)) >= _FEWEST_TRAINING_SAMPLES] or pieces
    warnings = [
        f"{piece.source}: the {len(piece)} samples from {piece.start_time:g} s on are too few to "
        f"fit and validate, so they were left out: record without gaps"
        for piece in pieces
        if piece not in kept
    ]
    return kept, warnings


def _held_out_start(piece: Recording, share: float) -> int:
    start = round(len(piece) * (1 - share))
    if start < _FEWEST_TRAINING_SAMPLES:
        raise RecordingError(
            piece.source,
            f"piece from {piece.start_time:g} s",
            f"leaves {start} samples to fit after {share:.0%} are kept out for validation, fewer "
            f"than {_FEWEST_TRAINING_SAMPLES}: record longer",
        )
    if len(piece) - start < _FEWEST_HELD_OUT_SAMPLES:
        raise SettingError(
            "validation-share",
            f"{share:g} keeps only {len(piece) - start} samples of {piece.source} out, fewer than "
            f"{_FEWEST_HELD_OUT_SAMPLES}: raise it, or record longer",
        )
    return start


def _choose(training: Sequence[Recording], system: ParametricSystem, settings: Settings) -> _Fitter:
    """Settle the hold and the filter rate on the training data.

    Holds are compared at one rate, for residuals at different rates say nothing about the hold;
    the rate is then chosen for the hold that it will be used with.
    """
    samples = [samples_of_recording(piece) for piece in training]

    def best_rate(hold: Hold) -> float:
        return settings.filter_rate or choose_filter_rate(samples, system, hold)

    if settings.hold != "auto":
        return _Fitter(system, best_rate(settings.hold), settings.hold)
    linear = _Fitter(system, best_rate("linear"), "linear")
    held = replace(linear, hold="zero")
    if _misfit(linear.fit(training)) <= _misfit(held.fit(training)):
        return linear
    return held.at(best_rate("zero"))


def _misfit(fit: LeastSquaresFit) -> float:
    return sum(row.residual_sum / row.total_sum for row in fit.rows)


def _excitation(fit: LeastSquaresFit) -> Mapping[str, Excitation]:
    return {
        row.name: excitation_of_gram(row.name, row.coefficients, row.gram / len(row.time))
        for row in fit.rows
    }


def _provenance(logs: Sequence[Log], settings: Settings, fitter: _Fitter) -> dict[str, object]:
    chosen = replace(settings, hold=fitter.hold, filter_rate=float(np.round(fitter.filter_rate, 6)))
    return {
        "flexid_version": flexid.__version__,
        "settings": {**asdict(settings), "terms": list(settings.terms)},
        "chosen": {"hold": chosen.hold, "filter_rate": chosen.filter_rate},
        "inputs": [{"file": log.source, "sha256": log.sha256} for log in logs],
    }
