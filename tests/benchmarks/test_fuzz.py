"""Every reader of files returns a result or raises one message, for any file."""

from pathlib import Path
from random import Random

import pytest
from benchmarks.fuzz import mutated, tried
from benchmarks.fuzz_targets import Targets, made_estimate

TEXTS = ("log, text", "column map", "drive file", "experiment file", "model file")
TEXTS += ("estimate", "watch, text")
# Each file takes a process and some time, so the command alone tries more of them.
APART = ("log, Parquet", "log, MATLAB", "log, MATLAB 7.3", "log, HDF5", "log, MDF", "log, MCAP")
APART += ("log, ROS 1 bag", "log, ROS 2 bag", "log, stream", "watch, MCAP", "watch, HDF5")
STRANGE = ("log, Parquet", "log, stream")  # not all of their seeds are valid files


@pytest.fixture(scope="module")
def readers() -> Targets:
    """Return every reader with its seeds."""
    return Targets(made_estimate())


@pytest.mark.parametrize(
    "name", [*TEXTS, *(pytest.param(name, marks=pytest.mark.thorough) for name in APART)]
)
def test_any_mutation(name: str, readers: Targets, tmp_path: Path) -> None:
    """Assert that a valid file is read, and that a mutated one is read or refused in one line."""
    target = readers[name]
    for good in () if name in STRANGE else target.seeds:
        assert tried(target, tmp_path / f"seed{target.suffix}", good) == ""
    for seed in range(60 if name in TEXTS else 4):
        content = mutated(Random(seed), target)
        assert tried(target, tmp_path / f"input{target.suffix}", content) in ("", None), seed
