"""The estimator in C99: it compiles anywhere, and its numbers are those of Python."""

from pathlib import Path

import pytest
from drive import LOG, compiled, run

import flexid

PRECISIONS = {"double": (), "float": ("-DFLEXID_FLOAT",)}

DRIVES = {
    "least squares, encoders": {"log": LOG},
    "least squares, encoders, straight lines": {"sample_time": 1e-3, "hold": "linear"},
    "least squares, velocities": {"sample_time": 1e-3, "velocities": True},
    "constant gain": {
        "sample_time": 1e-3,
        "velocities": True,
        "gain": {"link": 1.0, "motor": 2.0},
    },
    "velocities from positions": {
        "sample_time": 1e-3,
        "terms": ("gravity", "motor_viscous", "motor_coulomb"),
        "filter_rate": 50.0,
    },
}


@pytest.fixture(scope="module")
def drives(tmp_path_factory) -> dict[str, Path]:
    """Every kind of estimator, exported."""
    folder = tmp_path_factory.mktemp("drives")
    for number, options in enumerate(DRIVES.values()):
        flexid.export("flexible-joint", to="c99", out=folder / str(number), **options)
    return {name: folder / str(number) for number, name in enumerate(DRIVES)}


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("compiler", ["gcc", "clang"])
@pytest.mark.parametrize("name", DRIVES)
def test_replay_agrees_with_python(drives, tmp_path, name, compiler, precision):
    """Assert that the example compiles without a warning and finds what Python finds."""
    program = compiled(compiler, drives[name], *PRECISIONS[precision], out=tmp_path / "drive")
    run(program)
