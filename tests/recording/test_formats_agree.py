"""One log in every format is one log."""

import json
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import polars as pl
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from joint_log import Columns, assert_equal_logs, joint_columns, read_columns
from mcap.writer import Writer
from scipy.io import savemat

from flexid.recording import read_log

START = 1_700_000_000_000_000_000


def as_parquet(path: Path, columns: Columns) -> None:
    """Parquet."""
    pl.DataFrame(dict(columns)).write_parquet(path)


def as_matlab(path: Path, columns: Columns) -> None:
    """A struct of a MATLAB file."""
    savemat(path, {"log": dict(columns)}, do_compression=True)


def as_hdf5(path: Path, columns: Columns) -> None:
    """Datasets in a group."""
    with h5py.File(path, "w") as file:
        for name, values in columns.items():
            file[f"log/{name}"] = values


def as_mcap(path: Path, columns: Columns) -> None:
    """Messages of JSON."""
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        channel = writer.register_channel("/log", "json", 0)
        for index, time in enumerate(columns["time"]):
            row = {name: float(v[index]) for name, v in columns.items() if name != "time"}
            writer.add_message(channel, START + round(1e9 * time), json.dumps(row).encode(), 0)
        writer.finish()


FORMATS: dict[str, Callable[[Path, Columns], None]] = {
    ".parquet": as_parquet,
    ".mat": as_matlab,
    ".h5": as_hdf5,
    ".mcap": as_mcap,
}


@pytest.mark.parametrize("suffix", FORMATS)
@settings(
    max_examples=15,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(
    count=st.integers(20, 60),
    noise=st.floats(0.0, 1e-3),
    seed=st.integers(0, 2**32),
    order=st.permutations(range(6)),
    left_out=st.sampled_from([(), ("link_velocity",), ("link_velocity", "link_position")]),
)
def test_channels_are_the_same_bits(
    suffix: str,
    tmp_path: Path,
    count: int,
    noise: float,
    seed: int,
    order: list[int],
    left_out: tuple[str, ...],
):
    """Assert that whatever the channels, their number and order, every format gives their bits."""
    plain = joint_columns(count)
    draw = np.random.default_rng(seed)
    names = [list(plain)[index] for index in order]
    columns = {
        name: plain[name] + (0.0 if name == "time" else noise * draw.normal(size=count))
        for name in names
        if name not in left_out
    }
    FORMATS[suffix](tmp_path / f"log{suffix}", columns)
    assert_equal_logs(read_log(tmp_path / f"log{suffix}"), read_columns(columns))
