"""Record of one realistic log: the identified values and the truth."""

import tempfile
import warnings
from pathlib import Path

from benchmarks.trials.realistic.generate import RealisticTrial, make_realistic
from benchmarks.trials.record import Record, identified
from flexid.identification.preparation.settings import Settings


def recorded(family: str, seed: int) -> Record:
    """Draw a log, identify it as a user would, and return a record.

    Returns
    -------
    dict
        Ready for JSON: the result of `benchmarks.trials.record.identified`, and of `known`.
    """
    trial = make_realistic(family, seed)
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings(action="ignore"):
        path = Path(folder) / "log.csv"
        trial.write_csv(path)
        return known(trial) | identified(path, Settings())


def known(trial: RealisticTrial) -> Record:
    """Return the generator's information about a log, ready for JSON."""
    return {
        "family": trial.family,
        "seed": trial.seed,
        "realistic": True,
        "core": list(trial.core),
        "truth": {name: float(f"{value:.9g}") for name, value in trial.truth.items()},
        "sins": {name: float(f"{value:.4g}") for name, value in trial.sins.items()},
        "drawn": {
            name: value if isinstance(value, str) else float(f"{value:.4g}")
            for name, value in trial.about.items()
        },
    }
