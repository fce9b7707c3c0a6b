"""Sensitivity of blind trials to each threshold of an identification, halved and doubled.

    python -m benchmarks.thresholds [--seeds N] [--first-seed K] [--family F ...] [--jobs J]
                                    [--out FILE] [--page docs/intervals.md]

in the root of a clone. Every log is identified with the usual thresholds and with each one changed.
"""

import argparse
import json
import os
import tempfile
import warnings
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import fields, replace
from multiprocessing import get_context
from pathlib import Path
from textwrap import wrap
from typing import Any

from benchmarks.page_block import write_block
from benchmarks.report import markdown
from benchmarks.size import sized
from benchmarks.trials.families import FAMILIES
from benchmarks.trials.generate import make_trial
from benchmarks.trials.options import add_log_options, logs_of
from benchmarks.trials.record import identified, known
from benchmarks.trials.score import CORE, claims, core_names
from flexid.identification.preparation.settings import Settings
from flexid.identification.vocabulary.thresholds import THRESHOLDS, Thresholds

BLOCK = "sensitivity"
FACTORS = sized((0.5, 2.0), (2.0,))
UNTOUCHED = ("contradiction",)
"""Thresholds that need prior knowledge, which no trial has."""

Record = Mapping[str, Any]


def moved() -> Iterator[tuple[str, Thresholds]]:
    """Yield thresholds with one at half or twice its value, by names like ``hold_fall x 2``."""
    for field in sized(fields(THRESHOLDS), fields(THRESHOLDS)[:1]):
        if field.name not in UNTOUCHED:
            for factor in FACTORS:
                value = factor * getattr(THRESHOLDS, field.name)
                yield f"{field.name} x {factor:g}", replace(THRESHOLDS, **{field.name: value})


def of_log(task: tuple[str, int]) -> dict[str, Record]:
    """Return a log's records by changed threshold; the usual ones have the empty name."""
    trial = make_trial(*task)
    found = {}
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings(action="ignore"):
        path = Path(folder) / "log.csv"
        trial.write_csv(path)
        for name, thresholds in (("", THRESHOLDS), *moved()):
            found[name] = {**known(trial), **identified(path, Settings(), thresholds)}
    return found


def table(logs: Sequence[Mapping[str, Record]]) -> list[str]:
    """Return the changes as Markdown, without thresholds that change nothing."""
    headings = [
        "moved",
        "logs with other terms",
        "with another hold",
        "with other verdicts",
        "intervals that hold the truth, in class",
        "outside",
        "core determined, in class",
        "outside",
        "logs confidently wrong (core)",
    ]
    lines = [["nothing", "", "", "", *_scores([log[""] for log in logs])]]
    same: list[str] = []
    for name in [name for name in logs[0] if name]:
        pairs = [(log[""], log[name]) for log in logs]
        changes = [sum(part(a) != part(b) for a, b in pairs) for part in (_terms, _hold, _verdicts)]
        if any(changes):
            lines.append([f"`{name}`", *map(str, changes), *_scores([b for _, b in pairs])])
        else:
            same.append(name)
    found = markdown(headings, lines)
    return [*found, "", *wrap(f"Nothing changes with {_listed(same)}.", 98)] if same else found


def _listed(same: Sequence[str]) -> str:
    """Return the names that change nothing, without factor if neither value changes anything."""
    factors: dict[str, list[str]] = {}
    for name, _, factor in (one.partition(" x ") for one in same):
        factors.setdefault(name, []).append(factor)
    both = (
        f"`{name}`" if len(found) == 2 else f"`{name} x {found[0]}`"
        for name, found in factors.items()
    )
    return ", ".join(both)


def _terms(record: Record) -> Any:
    return sorted(record.get("chosen", {}).get("terms", ()))


def _hold(record: Record) -> Any:
    return record.get("chosen", {}).get("hold")


def _verdicts(record: Record) -> Any:
    return {name: status for name, (*_, status) in record.get("estimates", {}).items()}


def _scores(records: Sequence[Record]) -> list[str]:
    """Return coverage and determined core, in the model class and outside, and wrong logs."""
    cells = {}
    for in_class in (True, False):
        chosen = [record for record in records if record["in_class"] is in_class]
        counted = [c for record in chosen for c in claims(record) if c.kind != "delay"]
        core = [c for c in counted if c.name in CORE and c.truth and c.status == "determined"]
        cells[in_class] = (
            _percent(sum(c.holds for c in counted), len(counted)),
            _percent(len(core), sum(len(core_names(record)) for record in chosen)),
        )
    wrong = sum(any(c.confidently_wrong and c.name in CORE for c in claims(r)) for r in records)
    return [cells[i][k] for k in (0, 1) for i in (True, False)] + [str(wrong)]


def _percent(part: int, whole: int) -> str:
    return f"{100.0 * part / whole:.1f} %" if whole else "-"


def main() -> None:
    """Run the trials and print the table."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.thresholds",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_log_options(parser, 1, list(FAMILIES))
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="processes")
    parser.add_argument("--out", type=Path, help="file for the records, a line for each log")
    parser.add_argument("--page", type=Path, help="page whose table is made again")
    options = parser.parse_args()
    tasks = logs_of(options, FAMILIES)
    logs = []
    with ProcessPoolExecutor(options.jobs, get_context("spawn")) as pool:
        for task, found in zip(tasks, pool.map(of_log, tasks), strict=True):
            logs.append(found)
            print(*task, flush=True)
            if options.out:
                text = "".join(json.dumps(log, ensure_ascii=False) + "\n" for log in logs)
                options.out.write_text(text, encoding="utf-8")
    text = "\n".join(table(logs))
    print(text)
    if options.page:
        write_block(options.page, BLOCK, text)


if __name__ == "__main__":
    main()
