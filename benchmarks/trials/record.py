"""Record of one log of a trial: the identified values and the truth."""

import tempfile
import time
import traceback
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from benchmarks.trials.generate import Trial, make_trial
from benchmarks.trials.plain_least_squares import plain_least_squares
from flexid.errors import FlexidError
from flexid.identification.identify import identify
from flexid.identification.preparation.settings import Settings
from flexid.identification.vocabulary.thresholds import THRESHOLDS, Thresholds
from flexid.recording.read import read_log
from flexid.recording.recording import Log

_HOLDS = {"zero": "zero", "smooth": "cubic"}
"""Hold by flexid's name, for a trial's hold."""

Record = dict[str, Any]


def recorded(family: str, seed: int, with_structure: bool) -> Record:
    """Draw a log, identify it as a user would, and return a record.

    Parameters
    ----------
    family : str
    seed : int
    with_structure : bool
        Whether to identify it again with terms, hold and delays given, and to solve
        `plain_least_squares`.

    Returns
    -------
    dict
        Ready for JSON, in SI units. ``estimates``: value, ends of the interval and status by
        parameter; ``removed`` and ``delays``: without status; ``error`` instead, if the
        identification raised.
    """
    trial = make_trial(family, seed)
    record = known(trial)
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings(action="ignore"):
        path = Path(folder) / "log.csv"
        trial.write_csv(path)
        record |= identified(path, Settings())
        if with_structure:
            given = identified(path, given_settings(trial, trial.terms))
            record["given"] = given.get("estimates", {"error": given.get("error")})
            record["least_squares"] = _shortened(plain_least_squares(trial))
    return record


def known(trial: Trial) -> Record:
    """Return the generator's information about a log, ready for JSON."""
    return {
        "family": trial.family,
        "seed": trial.seed,
        "in_class": trial.in_class,
        "hold": _HOLDS[trial.hold],
        "terms": list(trial.terms),
        "truth": {name: value for name, value in _shortened(trial.truth, 9).items() if value},
        "drawn": _shortened(trial.metadata, 4),
    }


def identified(path: Path, settings: Settings, thresholds: Thresholds = THRESHOLDS) -> Record:
    """Identify a log and return the results, ready for JSON.

    Parameters
    ----------
    path : Path
        Path of the log.
    settings : Settings
    thresholds : Thresholds, optional
        Thresholds of the identification.
    """
    start = time.process_time()
    try:
        # Reading counts as well: it takes time and may raise.
        logs: list[Log] = [read_log(path)]
        result = identify(logs, settings, thresholds=thresholds)
    except Exception as error:  # any failure is a result
        refused = isinstance(error, FlexidError)
        place = traceback.extract_tb(error.__traceback__)[-1]
        where = "" if refused else f" ({Path(place.filename).name}:{place.lineno})"
        text = f"{type(error).__name__}: {error}".replace(str(path), "log.csv")
        return {"error": f"{text}{where}"[:400], "refused": refused}
    seconds = round(time.process_time() - start, 3)
    alignment = result.choices.alignment
    return {
        "seconds": seconds,
        "estimates": {
            name: [*_ends(estimate), estimate.verdict]
            for name, estimate in result.parameters.items()
        },
        "removed": {
            name: _ends(estimate) for name, estimate in getattr(result, "removed", {}).items()
        },
        "delays": {
            name: [_short(delay.value), *(_short(end) for end in delay.interval), delay.status]
            for name, delay in (
                ("input_delay", alignment.input_delay),
                ("link_delay", alignment.link_delay),
            )
        },
        "chosen": {"terms": list(result.choices.terms), "hold": result.choices.hold},
        "estimator": result.choices.estimator,
        "warnings": len(result.warnings),
    }


def given_settings(trial: Trial, terms: tuple[str, ...]) -> Settings:
    """Return settings with given terms, and the true hold and delays."""
    return Settings(
        terms=terms,
        hold="zero" if trial.hold == "zero" else "cubic",
        input_delay=trial.truth["input_delay"],
        link_delay=trial.truth["link_delay"],
    )


def _ends(estimate: Any) -> list[float]:
    return [_short(estimate.value), *(_short(end) for end in estimate.interval)]


def _short(value: float, digits: int = 8) -> float:
    return float(f"{value:.{digits}g}")


def _shortened(values: Mapping[str, Any], digits: int = 8) -> dict[str, Any]:
    return {
        name: value if isinstance(value, str) else _short(value, digits)
        for name, value in values.items()
    }
