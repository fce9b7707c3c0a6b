"""Effect of integration errors on the estimates of blind trials, before and after refinement.

    python -m benchmarks.integration [--first-seed N] [--seeds N] [--family F ...]

Terms, hold and delays are given. The effect is in standard deviations of the combination of values
that changes most: with steps chosen by the model's poles, and with those that
`flexid.estimators.prediction_error` requires.
"""

import argparse
import tempfile
import warnings
from pathlib import Path

import numpy as np

from benchmarks.trials.families import FAMILIES
from benchmarks.trials.generate import make_trial
from benchmarks.trials.record import given_settings
from flexid.errors import ConvergenceError
from flexid.estimators.prediction_error import FINE, integration_error
from flexid.identification.full_model.fitting import refit
from flexid.identification.preparation.recordings import prepare
from flexid.identification.structure.job import job_of
from flexid.recording.read import read_log

_EDGES = (0.1, 0.3, 1.0)


def errors(family: str, seed: int, folder: Path) -> tuple[float, float, int]:
    """Return the errors before and after, in standard deviations, and the ratio of steps.

    Parameters
    ----------
    family : str
    seed : int
    folder : Path
        Folder for the log.
    """
    trial = make_trial(family, seed)
    path = folder / "log.csv"
    trial.write_csv(path)
    settings = given_settings(trial, trial.terms)
    recordings, _ = prepare([read_log(path)], settings.validation_share, settings.model)
    last = job_of(recordings, settings).fitted_by_length().found[-1]
    states = last.minimum.point.initial_states
    fine = refit(last.structure, last.data, last.by_name, last.problem.segments, FINE, states)
    before, after = (integration_error(fit.problem, fit.minimum) for fit in (last, fine))
    return before, after, last.data.refinement


def main() -> None:
    """Print a line for each family."""
    parser = argparse.ArgumentParser(description="error of the integration, on blind trials")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--seeds", type=int, default=6)
    parser.add_argument("--family", action="append", choices=list(FAMILIES))
    given = parser.parse_args()
    in_class = [name for name, family in FAMILIES.items() if family.in_class]
    print(f"{'family':24} logs  {'over ' + ', '.join(map(str, _EDGES)):>18}  largest  then  steps")
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings(action="ignore"):
        for family in given.family or in_class:
            found = []
            for seed in range(given.first_seed, given.first_seed + given.seeds):
                try:
                    found.append(errors(family, seed, Path(folder)))
                except ConvergenceError as error:
                    print(f"{family} {seed}: {error}")
            before, after, times = np.array(found).T
            over = ", ".join(str(np.count_nonzero(before > edge)) for edge in _EDGES)
            print(
                f"{family:24} {len(found):4}  {over:>18}  {before.max():7.2g}  {after.max():.2g}  "
                f"{times.mean():.2f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
