"""Fuzz test of one reader by atheris, guided by branch coverage.

    python -m benchmarks.fuzz_guided ESTIMATE FOLDER TARGET [options of libFuzzer]

`benchmarks.fuzz --guided` runs it for every target. Branches of flexid and of the Python libraries
that it reads with are counted, and files that reach a new branch are mutated further. Faults are
defined as in `benchmarks.fuzz`.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import atheris
import scipy.optimize  # noqa: F401 - imported before the counting: only scipy.io reads files

_READERS = ["flexid", "asammdf", "mcap", "rosbags", "tomllib", "scipy.io"]


class FoundError(Exception):
    """A fault, which ends the run."""


def main() -> None:
    """Run until libFuzzer's time is over, or a fault is found."""
    estimate, folder, name, *options = sys.argv[1:]
    place = Path(folder)
    with atheris.instrument_imports(include=_READERS, enable_loader_override=False):
        from benchmarks.fuzz import tried
        from benchmarks.fuzz_inside import readers_inside
        from benchmarks.fuzz_targets import Targets

        target = Targets(Path(estimate).read_bytes())[name]
        path = place / f"input{target.suffix}"
        with readers_inside():
            for seed in target.seeds:  # so that late imports are counted, too
                tried(target, path, seed)
    corpus = place / "corpus"
    corpus.mkdir(exist_ok=True)
    for number, seed in enumerate(target.seeds):
        (corpus / f"seed{number}").write_bytes(seed)
    if target.words:
        words = ("".join(f"\\x{byte:02x}" for byte in word) for word in target.words)
        (place / "words").write_text("".join(f'"{word}"\n' for word in words))
        options.append(f"-dict={place / 'words'}")
    tally = {"read": 0, "refused": 0}

    def one(content: bytes) -> None:
        fault = tried(target, path, content)
        if fault:
            raise FoundError(fault)
        tally["refused" if fault is None else "read"] += 1
        if sum(tally.values()) % 20 == 0:
            (place / "tally.json").write_text(json.dumps(tally))

    atheris.Setup([sys.argv[0], str(corpus), *options], one)
    with readers_inside():
        atheris.Fuzz()


if __name__ == "__main__":
    main()
