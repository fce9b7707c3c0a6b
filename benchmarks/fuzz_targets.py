"""All readers of external files, with valid files for each."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from unittest.mock import patch

import polars as pl

from benchmarks import fuzz_files

Read = Callable[[Path], object]
Seeds = Callable[[], tuple[bytes, ...]]
ROOT = Path(__file__).parents[1]


@dataclass(frozen=True)
class Target:
    """A reader and its valid files.

    Parameters
    ----------
    suffix : str
        Suffix of the files' names.
    seeds : sequence of bytes
        Valid files.
    read : callable
        Function that reads a path.
    words : sequence of bytes
        Words of the format, for insertion.
    is_apart : bool
        Whether a child process reads it.
    """

    suffix: str
    seeds: tuple[bytes, ...]
    read: Callable[[Path], object]
    words: tuple[bytes, ...] = ()
    is_apart: bool = False


_TOML = (b"=", b"[", b"]", b"[[a]]", b"{", b"}", b'"""', b"= {", b"= [1, 'a']")
_JSON = (b"null", b"[]", b"{}", b'""', b"NaN", b"-Infinity", b":", b"1e400", b'"\\ud800"')
_HEADER = (b"time [ms]", b"(deg)", b"[rad]", b"tau", b"q_m", b"; ", b"\t", b"1,5", b"\xc2\xb0")
_EXPRESSIONS = (b"sin(", b"**", b"/0", b"abs(q)", b"__import__", b"lambda", b"1e999*")
_ENTRY = (
    b"gear_ratio = 3\n", b"sum = []", b'side = "link"', b"scale = '1/3'", b"offset = 1e300"
)  # fmt: skip
_MAPS = (
    b'gear_ratio = "1/2"\ntime = {column = "time", unit = "s"}\nmotor_position = '
    b'{sum = ["motor_position", {column = "motor_torque", scale = 0.0}], side = "link"}\n',
    b'# angles\n[deflection]\ncolumn = "Link_Position"\nscale = 0.1\nunit = "deg"\n',
)


class Targets(Mapping[str, Target]):
    """All readers, by what they read; files are made on request.

    Parameters
    ----------
    estimate : bytes
        An ``estimate.json``.
    """

    def __init__(self, estimate: bytes) -> None:
        self._made: dict[str, Target] = {}
        self._makers = {**_logs(), **_descriptions(), **_estimates(estimate), **_streams()}

    def __getitem__(self, name: str) -> Target:
        if name not in self._made:
            self._made[name] = self._makers[name]()
        return self._made[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._makers)

    def __len__(self) -> int:
        return len(self._makers)


def _logs() -> dict[str, Callable[[], Target]]:
    from flexid.readers.formats import FORMATS
    from flexid.recording import read_log
    from flexid.streaming.incoming import Replay

    def stream(path: Path) -> None:
        with closing(Replay(path, None)) as replay:
            for _ in replay:
                pass

    def texts() -> tuple[bytes, ...]:
        text = fuzz_files.log_text()
        return (
            text,
            b"# " + text.replace(b",", b" "),
            text.replace(b",", b";").replace(b".", b","),
            b"Logger 3\n\n" + text.replace(b"\n", b"\ns,rad,rad,Nm\n", 1),
        )

    def apart(suffix: str, seeds: Seeds, read: Read = read_log) -> Callable[[], Target]:
        return lambda: Target(suffix, seeds(), read, (), is_apart=True)

    found = {"log, text": lambda: Target(".csv", texts(), read_log, _HEADER)}
    for one in FORMATS:
        seeds = fuzz_files.SEEDS.get(one.name, lambda one=one: (*one.magic, b"anything"))
        found[f"log, {one.name}"] = apart(one.suffixes[0], seeds)
    found["log, MATLAB 7.3"] = apart(".mat", fuzz_files.log_matlab_73)
    found["log, stream"] = apart(".parquet", fuzz_files.SEEDS["Parquet"], stream)
    return found


def _descriptions() -> dict[str, Callable[[], Target]]:
    from flexid.experiment_design.drive import read_drive
    from flexid.experiments.experiment import read_experiment
    from flexid.models.model_file import read_model
    from flexid.recording.columns import read_channels
    from flexid.recording.table import Table

    table = Table("log.csv", pl.DataFrame(fuzz_files.log_columns()), row_word="line")

    def of(pattern: str, read: Callable[[Path], object], *words: bytes) -> Target:
        files = tuple(path.read_bytes() for path in sorted(ROOT.glob(pattern)))
        return Target(".toml", files, read, (*_TOML, *words))

    return {
        "column map": lambda: Target(
            ".toml", _MAPS, lambda path: read_channels(table, path), (*_TOML, *_ENTRY)
        ),
        "drive file": lambda: of("examples/drive.toml", read_drive),
        "experiment file": lambda: of("experiments/*.toml", read_experiment, *_EXPRESSIONS),
        "model file": lambda: of("examples/models/*.toml", read_model, *_EXPRESSIONS),
    }


def _estimates(estimate: bytes) -> dict[str, Callable[[], Target]]:
    from flexid.stored_estimates.estimate_file import read_estimate

    files = (estimate, json.dumps(json.loads(estimate), indent=0).encode())
    return {"estimate": lambda: Target(".json", files, read_estimate, _JSON)}


def _streams() -> dict[str, Callable[[], Target]]:
    from flexid.streaming import incoming
    from flexid.streaming.incoming import TextStream
    from flexid.streaming.options import WatchOptions
    from flexid.streaming.session import Session

    def watch(path: Path) -> None:
        """Watch a text that arrives in parts."""
        stream, raw = TextStream("stream"), path.read_bytes()
        session = Session(WatchOptions(0.005))
        for start in range(0, len(raw) + 1, 5_000):
            samples = stream.samples(raw[start : start + 5_000], ended=start + 5_000 > len(raw))
            if samples.shape[1] == 4:  # time, both positions, input
                session.feed(samples)

    def replay(path: Path) -> None:
        """Replay a log in parts."""
        with patch.object(incoming, "BLOCK", 30):
            for _ in incoming.Replay(path, None):
                pass

    return {
        "watch, text": lambda: Target(".csv", (fuzz_files.log_text(),), watch, _HEADER),
        "watch, MCAP": lambda: Target(".mcap", fuzz_files.SEEDS["MCAP"](), replay, (), True),
        "watch, HDF5": lambda: Target(".h5", fuzz_files.SEEDS["HDF5"](), replay, (), True),
    }


def made_estimate() -> bytes:
    """Return an estimate of the example log's beginning."""
    from flexid.arrays import to_json
    from flexid.identification.identify import identify
    from flexid.identification.preparation.settings import Settings
    from flexid.recording import read_log
    from flexid.stored_estimates.estimate_file import estimate_document

    with tempfile.TemporaryDirectory() as folder:
        lines = (ROOT / "examples" / "flexible_joint.csv").read_bytes().split(b"\n")[:3001]
        (Path(folder) / "log.csv").write_bytes(b"\n".join(lines))
        settings = Settings(
            terms=("gravity", "motor_viscous"), hold="zero", input_delay=0.0, link_delay=0.0
        )
        result = identify([read_log(Path(folder) / "log.csv")], settings)
    return to_json(estimate_document(result)).encode()
