"""Error rate and power of `flexid compare`, on an unchanged drive and on a stiffer one.

The drives are those of the blind trials. Each is recorded twice unchanged and with 1, 2 and 5 %
more stiffness, each time with another motion, encoder and noise, and again with the first motion.
Run it in the root of the repository::

    python -m benchmarks.comparing --seeds 10 --kept FOLDER --page docs/results.md
"""

import argparse
import json
import sys
import tempfile
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from benchmarks.page_block import write_block
from benchmarks.report import markdown
from benchmarks.size import sized
from benchmarks.trials.families import FAMILIES
from benchmarks.trials.generate import Trial
from benchmarks.trials.options import add_log_options, logs_of
from benchmarks.trials.repeated import make_repeated
from flexid.arrays import to_json
from flexid.errors import FlexidError
from flexid.identification.identify import identify
from flexid.identification.preparation.settings import Settings
from flexid.identification.result import Identification
from flexid.recording.read import read_log
from flexid.stored_estimates.comparison import Comparison, compare_estimates
from flexid.stored_estimates.estimate_file import estimate_document, read_estimate

BLOCK = "comparing"
USUAL = ("basic", "coulomb", "lugre", "spring_other")
_STIFFER = sized({"1": 1.01, "2": 1.02, "5": 1.05}, {"5": 1.05})  # factor by per cent
_RECORDINGS = ({}, {}, *({"joint_stiffness": factor} for factor in _STIFFER.values()))
_NAMES = ("before", "same", *_STIFFER, "motion")  # "motion" repeats the first motion

HEADINGS = (
    "family",
    "in the model class",
    "another motion: intervals that miss 0",
    "answers that are wrong",
    "the same motion: intervals that miss 0",
    "answers that are wrong",
    "half-width of the stiffness's difference",
    *(f"{share} % more stiffness found" for share in _STIFFER),
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    add_log_options(parser, 10, FAMILIES)
    parser.add_argument("--kept", type=Path, required=True, help="folder of what was identified")
    parser.add_argument("--page", type=Path, help="page to write the table into")
    options = parser.parse_args()
    options.family = options.family or list(USUAL)
    for family, seed in logs_of(options, FAMILIES):
        _record(options.kept, family, seed)
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    lines = [_line(options.kept, family, seeds) for family in options.family]
    table = "\n".join([*markdown(list(HEADINGS), lines), ""])
    print(table)
    if options.page is not None:
        write_block(options.page, BLOCK, table)


def _record(kept: Path, family: str, seed: int) -> None:
    """Record and identify a drive, unless the files exist."""
    files = [_file(kept, family, seed, name) for name in _NAMES]
    if all(file.exists() for file in files):
        return
    kept.mkdir(parents=True, exist_ok=True)
    for file, trial in zip(files, make_repeated(family, seed, _RECORDINGS), strict=True):
        if not file.exists():
            file.write_text(_estimate(trial), encoding="utf-8")
            print(file.name, file=sys.stderr)


def _file(kept: Path, family: str, seed: int, name: str) -> Path:
    return kept / f"{family}-{seed}-{name}.json"


def _estimate(trial: Trial) -> str:
    """Return the estimate of a log as JSON, or the error."""
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings(action="ignore"):
        path = Path(folder) / "log.csv"
        trial.write_csv(path)
        try:
            return to_json(estimate_document(identify([read_log(path)], Settings())))
        except FlexidError as error:
            return json.dumps({"error": str(error)})


def _line(kept: Path, family: str, seeds: Sequence[int]) -> list[str]:
    """Return the table's line of a family."""
    again = [*_comparisons(kept, family, seeds, "same")]
    stiffness = [c.parameters["joint_stiffness"] for c in again]
    widths = [float(np.ptp(d.percent_interval)) / 2.0 for d in stiffness if d.compared]
    found = []
    for name in _STIFFER:
        pairs = [*_comparisons(kept, family, seeds, name)]
        found.append(f"{sum(map(_stiffer, pairs))} of {len(pairs)}")
    return [
        family,
        "yes" if FAMILIES[family].in_class else "no",
        *_wrong(again),
        *_wrong([*_comparisons(kept, family, seeds, "motion")]),
        f"{np.median(widths):.2g} %",
        *found,
    ]


def _wrong(comparisons: Sequence[Comparison]) -> tuple[str, str]:
    """Return the false alarms for an unchanged drive: of intervals, and of answers."""
    differences = [d for c in comparisons for d in c.parameters.values() if d.compared]
    missed = sum(d.probability < 0.05 for d in differences)
    wrong = sum(c.differ for c in comparisons)
    return f"{missed} of {len(differences)}", f"{wrong} of {len(comparisons)}"


def _stiffer(comparison: Comparison) -> bool:
    """Whether the comparison reports a change of the stiffness."""
    return comparison.parameters["joint_stiffness"].outcome == "changed"


def _comparisons(kept: Path, family: str, seeds: Sequence[int], name: str) -> Iterator[Comparison]:
    for seed in seeds:
        pair = [_read(_file(kept, family, seed, which)) for which in ("before", name)]
        if pair[0] is not None and pair[1] is not None:
            yield compare_estimates(pair[0], pair[1])


def _read(file: Path) -> Identification | None:
    if "error" in json.loads(file.read_text(encoding="utf-8")):
        return None
    return read_estimate(file).of_joint


if __name__ == "__main__":
    main()
