"""Result objects as plain documents for JSON, and files that appear whole or not at all."""

from __future__ import annotations

import json
import math
import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexid.analysis.excitation import Excitation
from flexid.atomic import write_atomically
from flexid.errors import SettingError
from flexid.stored_estimates.estimate_file import FORMAT_VERSION

if TYPE_CHECKING:  # most documents are not an identification's
    from flexid.identification.result.identification import Choices, Identification
    from flexid.identification.vocabulary.evidence import CoefficientEstimate, ParameterEstimate


def identification_document(result: Identification) -> dict[str, Any]:
    """Everything of an identification but its time series, ready for JSON.

    `flexid.stored_estimates.estimate_file.stored_identification` is the way back.
    """
    return {
        "format_version": FORMAT_VERSION,
        "coefficients": _estimates_document(result.coefficients),
        "parameters": _estimates_document(result.parameters),
        "removed": _estimates_document(result.removed),
        "fit": {
            "names": list(result.fit.names),
            "values": result.fit.values.tolist(),
            "covariance": result.fit.covariance.tolist(),
            "degrees_of_freedom": list(result.fit.degrees_of_freedom),
        },
        "excitation": {row: excitation_summary(e) for row, e in result.excitation.items()},
        "residual_excess": dict(result.residual_excess),
        "model_error": asdict(result.model_error),
        "disturbances": asdict(result.disturbances) if result.disturbances else None,
        "validation": {
            "fit_percent": dict(result.validation.fit_percent),
            "horizons": {
                f"{horizon:g}": dict(fits) for horizon, fits in result.validation.horizons.items()
            },
        },
        "observer": {
            "final": dict(
                zip(result.observer.names, map(float, result.observer.estimates[-1]), strict=True)
            ),
            "gains": dict(result.observer.gains),
        },
        "model": result.model,
        "least_squares": dict(result.least_squares),
        "compliance": {
            "visible": result.compliance.visible,
            "reason": result.compliance.reason,
            "rigid_fit_percent": dict(result.compliance.rigid_fit_percent),
            "deflection": result.compliance.deflection,
            "deflection_noise": result.compliance.deflection_noise,
        },
        "choices": _choices_document(result.choices),
        "summary": list(result.summary),
        "warnings": list(result.warnings),
        "provenance": dict(result.provenance),
    }


def _estimates_document(
    estimates: Mapping[str, CoefficientEstimate] | Mapping[str, ParameterEstimate],
) -> dict[str, Any]:
    return {
        name: {
            "value": e.value,
            "std": e.std,
            "interval": list(e.interval),
            "unit": e.unit,
            "verdict": e.verdict,
            "reason": e.reason,
            "degrees_of_freedom": e.degrees_of_freedom,
            "logarithmic": e.logarithmic,
            "slopes": dict(e.slopes),
        }
        for name, e in estimates.items()
    }


def _choices_document(choices: Choices) -> dict[str, Any]:
    alignment = choices.alignment
    return {
        "terms": list(choices.terms),
        "hold": choices.hold,
        "hold_reason": alignment.hold_reason,
        "input_delay": asdict(alignment.input_delay),
        "link_delay": asdict(alignment.link_delay),
        "coulomb_velocity": choices.coulomb_velocity,
        "filter_rate": choices.filter_rate,
        "estimator": choices.estimator,
        "segment_duration": choices.segment_duration,
        "term_evidence": [asdict(e) for e in choices.term_evidence],
        "shapes": dict(choices.shapes),
        "segment_evidence": [asdict(e) for e in choices.segment_evidence],
    }


def excitation_summary(excitation: Excitation) -> dict[str, Any]:
    """Excitation of one row, ready for JSON."""
    return {
        "coefficients": list(excitation.coefficients),
        "condition_number": excitation.condition_number,
        "singular_values": excitation.singular_values.tolist(),
        "direction": excitation.direction.tolist(),
        "level": excitation.level,
        "confounded": list(excitation.confounded),
        "correlated": list(excitation.correlated),
        "correlation": excitation.correlation,
    }


def to_json(document: Mapping[str, Any]) -> str:
    """Text of a document; numbers that JSON does not have become null."""
    return json.dumps(_finite(document), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def _finite(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def write_document(path: Path, text: str) -> None:
    """Write a file that appears whole or not at all."""
    temporary = None

    def write(place: Path) -> None:
        nonlocal temporary
        temporary = place
        place.write_text(text, encoding="utf-8")

    try:
        write_atomically(path, write)
    except (OSError, ValueError) as error:  # ValueError: a null character in the path
        if temporary is not None:
            temporary.unlink(missing_ok=True)
        reason = getattr(error, "strerror", None) or "its name cannot be used"
        raise SettingError("path", f"{path} cannot be written ({reason})") from None


@contextmanager
def output_directory(out: Path) -> Iterator[Path]:
    """Directory to write into, whose files move to `out` only when all are written."""
    existed = out.exists()
    try:
        str(out).encode()
    except UnicodeEncodeError:  # Polars cannot write there
        raise SettingError("--out", "its name is not UTF-8: name another directory") from None
    try:
        out.mkdir(parents=True, exist_ok=True)
        staging = Path(tempfile.mkdtemp(prefix=".flexid-", dir=out))
    except OSError as error:
        raise SettingError("--out", f"{out} cannot be written ({error.strerror})") from None
    try:
        yield staging
        _move_all(staging, out)
    except BaseException:
        shutil.rmtree(staging if existed else out, ignore_errors=True)
        raise
    staging.rmdir()


def _move_all(staging: Path, out: Path) -> None:
    files = list(staging.iterdir())
    for file in files:
        if (out / file.name).is_dir():  # before the first move, so that none is left half done
            raise SettingError("--out", f"{out / file.name} is a directory: move it away")
    for file in files:
        os.replace(file, out / file.name)
