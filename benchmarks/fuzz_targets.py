"""Every reader of files that come from outside, with files that it reads."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import polars as pl

from benchmarks import fuzz_files

ROOT = Path(__file__).parents[1]


@dataclass(frozen=True)
class Target:
    """A reader and what it is tried with.

    Parameters
    ----------
    suffix : str
        Of the files' names.
    seeds : sequence of bytes
        Files that are read.
    read : callable
        Reads a path.
    words : sequence of bytes
        Of the format, for insertion.
    """

    suffix: str
    seeds: tuple[bytes, ...]
    read: Callable[[Path], object]
    words: tuple[bytes, ...] = ()


def targets(estimate: bytes) -> dict[str, Target]:
    """Every reader, by what it reads.

    Parameters
    ----------
    estimate : bytes
        An ``estimate.json``.
    """
    from flexid.experiment_design.drive_file import read_drive
    from flexid.experiments.experiment_file import read_experiment
    from flexid.identification.estimate_file import read_estimate, stored_identification
    from flexid.identification.validate_estimate import validate_estimate
    from flexid.models.model_file import read_model
    from flexid.recording import read_log
    from flexid.recording.columns import read_channels
    from flexid.recording.stream import LogStream
    from flexid.recording.table import Table

    table = Table("log.csv", "line 1", 2, "line", pl.DataFrame(fuzz_files.log_columns()), "")

    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "log.csv").write_bytes(
            pl.DataFrame(fuzz_files.log_columns(400)).write_csv().encode()
        )
        log = read_log(Path(folder) / "log.csv")
    drive = ROOT / "examples" / "drive.toml"

    def stream(path: Path) -> None:
        for _ in LogStream(path, None, 50).chunks(30):
            pass

    def of(folder: str) -> tuple[bytes, ...]:
        return tuple(path.read_bytes() for path in sorted(ROOT.glob(folder)))

    parquets = (*fuzz_files.log_parquet() * 10, *fuzz_files.strange_parquet())
    text, toml = (
        fuzz_files.log_text(),
        (b"=", b"[", b"]", b"[[a]]", b"{", b"}", b'"""', b"= {", b"= [1, 'a']"),
    )
    logs = (
        text,
        b"# " + text.replace(b",", b" "),
        text.replace(b",", b";").replace(b".", b","),
        b"Logger 3\n\n" + text.replace(b"\n", b"\ns,rad,rad,Nm\n", 1),
    )
    maps = (
        b'gear_ratio = "1/2"\ntime = {column = "time", unit = "s"}\nmotor_position = '
        b'{sum = ["motor_position", {column = "motor_torque", scale = 0.0}], side = "link"}\n',
        b'# angles\n[deflection]\ncolumn = "Link_Position"\nscale = 0.1\nunit = "deg"\n',
    )
    estimates = (estimate, json.dumps(json.loads(estimate), indent=0).encode())
    json_words = (b"null", b"[]", b"{}", b'""', b"NaN", b"-Infinity", b":", b"1e400", b'"\\ud800"')
    entry = (
        b"gear_ratio = 3\n",
        b"sum = []",
        b'side = "link"',
        b"scale = '1/3'",
        b"offset = 1e300",
    )
    header = (b"time [ms]", b"(deg)", b"[rad]", b"tau", b"q_m", b"; ", b"\t", b"1,5", b"\xc2\xb0")
    expressions = (b"sin(", b"**", b"/0", b"abs(q)", b"__import__", b"lambda", b"1e999*")
    return {
        "log, text": Target(".csv", logs, read_log, header),
        "log, Parquet": Target(".parquet", parquets, read_log),
        "log, stream": Target(".parquet", parquets, stream),
        "log, MATLAB": Target(".mat", fuzz_files.log_matlab(), read_log),
        "log, MATLAB 7.3": Target(".mat", fuzz_files.log_hdf5(is_matlab=True), read_log),
        "log, HDF5": Target(".h5", fuzz_files.log_hdf5(), read_log),
        "log, MDF": Target(".mf4", fuzz_files.log_mdf(), read_log),
        "log, MCAP": Target(
            ".mcap", (*fuzz_files.log_json_mcap(), *fuzz_files.log_bag2("MCAP")), read_log
        ),
        "log, ROS 1 bag": Target(".bag", fuzz_files.log_bag1(), read_log),
        "log, ROS 2 bag": Target(".db3", fuzz_files.log_bag2("SQLITE3"), read_log),
        "column map": Target(".toml", maps, lambda p: read_channels(table, p), (*toml, *entry)),
        "drive file": Target(".toml", of("examples/drive.toml"), read_drive, toml),
        "experiment file": Target(
            ".toml", of("experiments/*.toml"), read_experiment, (*toml, *expressions)
        ),
        "model file": Target(
            ".toml", of("examples/models/*.toml"), read_model, (*toml, *expressions)
        ),
        "estimate": Target(
            ".json", estimates, lambda path: stored_identification(read_estimate(path)), json_words
        ),
        "estimate, validated": Target(
            ".json", estimates, lambda path: validate_estimate(path, [log]), json_words
        ),
        "estimate for a design": Target(
            ".json", estimates, lambda path: read_drive(drive, path), json_words
        ),
    }


def made_estimate() -> bytes:
    """An estimate of the example log's beginning."""
    from flexid.identification.identify import identify
    from flexid.identification.settings import Settings
    from flexid.recording import read_log
    from flexid.report.documents import identification_document, to_json

    with tempfile.TemporaryDirectory() as folder:
        lines = (ROOT / "examples" / "flexible_joint.csv").read_bytes().split(b"\n")[:3001]
        (Path(folder) / "log.csv").write_bytes(b"\n".join(lines))
        settings = Settings(
            terms=("gravity", "motor_viscous"), hold="zero", input_delay=0.0, link_delay=0.0
        )
        result = identify([read_log(Path(folder) / "log.csv")], settings)
    return to_json(identification_document(result)).encode()
