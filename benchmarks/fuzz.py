"""Files as nobody means to write them: what every reader of flexid makes of them.

    python -m benchmarks.fuzz [--seconds 60] [--seed 1] [--keep FOLDER] [TARGET ...]

Each target is a reader with files that it reads. They are mutated by bytes, lines, numbers, words
of the format and encodings, and given to it. It may return, or raise a `FlexidError` of one line;
whatever else it raises, an input that takes longer than a limit, and memory that grows beyond one,
is a fault: the file is kept, and the exit status is 1.
"""

from __future__ import annotations

import argparse
import codecs
import io
import json
import random
import re
import subprocess
import sys
import tempfile
import time
import warnings
import zlib
from collections import Counter
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from datetime import date, datetime, timedelta
from datetime import time as dt_time
from decimal import Decimal
from pathlib import Path

import numpy as np
import polars as pl

from flexid.errors import FlexidError

ROOT = Path(__file__).parents[1]
LONGEST = 5.0  # s of processor that one file may take
HANG = 60.0  # s of grace before a process is taken to hang
PER_PROCESS = 5_000  # files
LARGEST = 300_000  # bytes of a mutated file
MOST_GROWTH = 500.0  # MB of memory, while a target is tried
_NUMBER = re.compile(rb"\d+(?:\.\d+)?(?:[eE][+-]?\d+)?")
_EXTREMES = (
    b"0 -0 -1 1e308 -1e308 1e999 1e-320 nan inf 9007199254740993 99999999999999999999 0.1.2 1_0 "
    b"0x1F 1,5 true null 1e 00:01:02 2024-05-01"
).split()
_ANY = (
    b"",
    b"\0",
    b"\r",
    b"\n\n",
    b'"',
    b"'",
    b"\\",
    b"#",
    b"\xb0",
    b"\xff",
    b"\xef\xbb\xbf",
    b"  ",
)

Mutation = Callable[[random.Random, bytes, "Target"], bytes]


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


@dataclass
class Tally:
    """What became of the files of one target."""

    read: int = 0
    refused: int = 0
    longest: float = 0.0
    seconds: float = 0.0
    growth: float = 0.0
    faults: list[str] = field(default_factory=list)

    @property
    def files(self) -> int:
        """How many there were."""
        return self.read + self.refused + len(self.faults)

    def add(self, other: Tally) -> None:
        """Join what another process tallied."""
        self.read += other.read
        self.refused += other.refused
        self.longest = max(self.longest, other.longest)
        self.seconds += other.seconds
        self.growth = max(self.growth, other.growth)
        self.faults += other.faults


def mutated(draw: random.Random, target: Target) -> bytes:
    """One of the target's files, changed in a few ways."""
    content = draw.choice(target.seeds)
    for _ in range(draw.randint(1, 4)):
        content = draw.choice(_MUTATIONS)(draw, content, target)
    return content[:LARGEST]


def _place(draw: random.Random, content: bytes) -> int:
    # Most of a format is at the beginning of a file.
    return draw.randint(0, min(len(content), draw.choice((100, 1000, LARGEST))))


def _bytes(draw: random.Random, content: bytes, _: Target) -> bytes:
    start = _place(draw, content)
    count = draw.choice((0, 1, 1, 2, 10, 1000))
    new = bytes(draw.randint(0, 255) for _ in range(draw.randint(0, 4)))
    return content[:start] + new + content[start + count :]


def _word(draw: random.Random, content: bytes, target: Target) -> bytes:
    start = _place(draw, content)
    word = draw.choice((*target.words, *_ANY))
    return content[:start] + word * draw.choice((1, 1, 1, 3, 2000)) + content[start:]


def _number(draw: random.Random, content: bytes, _: Target) -> bytes:
    found = [match.span() for match in _NUMBER.finditer(content[: draw.choice((500, LARGEST))])]
    if not found:
        return content
    start, stop = draw.choice(found)
    return content[:start] + draw.choice(_EXTREMES) + content[stop:]


def _lines(draw: random.Random, content: bytes, target: Target) -> bytes:
    lines = content.split(b"\n")
    at = draw.randint(0, min(len(lines) - 1, draw.choice((3, 10, LARGEST))))
    kind = draw.randint(0, 6)
    if kind == 0:
        del lines[at]
    elif kind == 1:
        lines.insert(draw.randint(0, len(lines)), lines[at])
    elif kind == 2:
        lines[at : at + 2] = [b"".join(lines[at : at + 2])]
    elif kind == 3:
        lines.insert(at, draw.choice((*target.words, *_ANY)))
    elif kind == 4:
        cells = lines[at].split(b",")
        del cells[draw.randint(0, len(cells) - 1)]
        lines[at] = b",".join(cells)
    elif kind == 5:
        lines = lines[:at]
    else:
        lines.insert(at, draw.choice(draw.choice(target.seeds).split(b"\n")))
    return b"\n".join(lines)


def _whole(draw: random.Random, content: bytes, _: Target) -> bytes:
    text = content.decode("utf-8", errors="replace")
    kind = draw.randint(0, 6)
    if kind == 0:
        return codecs.BOM_UTF16_LE + text.encode("utf-16-le")
    if kind == 1:
        return text.encode("latin-1", errors="replace")
    if kind == 2:
        return content.replace(b"\n", draw.choice((b"\r\n", b"\r", b"\n\n", b" \n", b",\n")))
    if kind == 3:
        return content.replace(b",", draw.choice((b";", b"\t", b" ", b"|", b",,")))
    if kind == 4:
        return content.replace(b".", draw.choice((b",", b"..", b"")))
    if kind == 5:
        return content.upper() if draw.randint(0, 1) else content.swapcase()
    return (content * draw.randint(2, 20))[:LARGEST]


def _deep(draw: random.Random, content: bytes, _: Target) -> bytes:
    start = _place(draw, content)
    deep = draw.choice((b"[", b"{", b"(", b'{"a":', b"a.", b"-", b"[[a.", b"sin("))
    return content[:start] + deep * draw.choice((3, 100, 20_000)) + content[start:]


_MUTATIONS: tuple[Mutation, ...] = (_bytes, _word, _number, _number, _lines, _lines, _whole, _deep)


def tried(target: Target, path: Path, content: bytes) -> str | None:
    """What the reader makes of a file: the first line of a fault, or None if it is as it should be.

    Returns
    -------
    str or None
        Empty for a file that was read.
    """
    path.write_bytes(content)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            target.read(path)
    except FlexidError as error:
        message = str(error)
        return None if message and "\n" not in message else f"message of lines: {message[:200]!r}"
    except BaseException as error:  # whatever it is, it is what is looked for
        if isinstance(error, KeyboardInterrupt):
            raise
        return f"{type(error).__name__}: {error}".splitlines()[0][:200]
    return ""


def fuzz(target: Target, files: int, seconds: float, seed: int, folder: Path) -> Tally:
    """Try a reader with so many files, or for so long; faults are kept in `folder`."""
    draw = random.Random(seed)
    tally = Tally()
    before = _peak()
    start = time.perf_counter()
    path = folder / f"input{target.suffix}"
    while tally.files < files and tally.seconds < seconds:
        content = mutated(draw, target)
        begun = time.process_time()
        fault = tried(target, path, content)
        took = time.process_time() - begun
        tally.longest = max(tally.longest, took)
        if took > LONGEST:
            fault = f"took {took:.0f} s"
        tally.read += fault == ""
        tally.refused += fault is None
        if fault:
            tally.faults.append(fault)
            _keep(path, fault)
        tally.seconds = time.perf_counter() - start
    tally.growth = _peak() - before
    if tally.growth > MOST_GROWTH:
        tally.faults.append(f"memory grew by {tally.growth:.0f} MB")
    return tally


def _keep(path: Path, fault: str) -> None:
    """Keep the file that a fault came from."""
    kept = path.with_name(f"{zlib.crc32(path.read_bytes()):08x}{path.suffix}")
    path.replace(kept)
    print(f"  {kept}: {fault}", file=sys.stderr)


def _peak() -> float:
    """Largest resident memory of the process so far, in MB; zero where the system does not say."""
    status = Path("/proc/self/status")  # getrusage counts what the parent had, too
    if not status.exists():
        return 0.0
    return int(status.read_text().partition("VmHWM:")[2].split()[0]) / 1e3


def log_columns(rows: int = 100) -> dict[str, np.ndarray]:
    """A small log with two encoders."""
    t = 0.005 * np.arange(rows)
    motor = np.sin(20.0 * t) + 0.4 * np.sin(53.0 * t)
    return {
        "time": t,
        "link_position": motor + 0.05 * np.sin(37.0 * t + 1.0),
        "motor_position": motor,
        "motor_torque": 20.0 * np.sin(20.0 * t),
    }


def log_text() -> bytes:
    """It as a CSV file."""
    return pl.DataFrame(log_columns()).write_csv(float_precision=6).encode()


def log_parquet() -> tuple[bytes, ...]:
    """It as Parquet files."""
    buffers = []
    for compression in ("zstd", "snappy", "uncompressed"):
        buffers.append(io.BytesIO())
        pl.DataFrame(log_columns()).write_parquet(buffers[-1], compression=compression)
    return tuple(buffer.getvalue() for buffer in buffers)


def strange_parquet() -> tuple[bytes, ...]:
    """Parquet files with columns of every type where numbers are expected."""
    frame = pl.DataFrame(log_columns())
    rows = frame.height
    columns = (
        pl.Series(["1.5"] * rows), pl.Series([b"1.5"] * rows), pl.Series([True] * rows),
        pl.Series([None] * rows), pl.Series([[1.0, 2.0]] * rows), pl.Series([{"a": 1.0}] * rows),
        pl.Series([date(2024, 5, 1)] * rows), pl.Series([datetime(2024, 5, 1)] * rows),
        pl.Series([timedelta(seconds=1)] * rows), pl.Series([dt_time(12)] * rows),
        pl.Series([Decimal("1.5")] * rows), pl.Series(["a"] * rows, dtype=pl.Categorical),
        pl.Series([1.0, None] * (rows // 2)), pl.Series([np.inf] * rows),
        pl.Series(range(rows), dtype=pl.Int8), pl.Series(range(rows), dtype=pl.UInt64) + 2**60,
        pl.Series(range(rows), dtype=pl.Float32),
    )  # fmt: skip
    files = []
    for column in columns:
        for name in ("time", "motor_torque"):
            buffer = io.BytesIO()
            frame.with_columns(column.alias(name)).write_parquet(buffer)
            files.append(buffer.getvalue())
    return tuple(files)


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

    table = Table("log.csv", "line 1", 2, "line", pl.DataFrame(log_columns()), "")

    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "log.csv").write_bytes(pl.DataFrame(log_columns(400)).write_csv().encode())
        log = read_log(Path(folder) / "log.csv")
    drive = ROOT / "examples" / "drive.toml"

    def stream(path: Path) -> None:
        for _ in LogStream(path, None, 50).chunks(30):
            pass

    def of(folder: str) -> tuple[bytes, ...]:
        return tuple(path.read_bytes() for path in sorted(ROOT.glob(folder)))

    parquets = (*log_parquet() * 10, *strange_parquet())
    text, toml = log_text(), (b"=", b"[", b"]", b"[[a]]", b"{", b"}", b'"""', b"= {", b"= [1, 'a']")
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


def _in_processes(name: str, seconds: float, seed: int, keep: Path) -> Tally:
    """Try a reader in processes of a few thousand files, so that one that dies is noticed."""
    folder = keep / re.sub(r"\W+", "-", name)
    folder.mkdir(parents=True, exist_ok=True)
    estimate = keep / "estimate.json"
    tally = Tally()
    while tally.seconds < seconds:
        begun = time.perf_counter()
        command = [sys.executable, "-m", "benchmarks.fuzz", "--child", str(estimate), str(folder)]
        left = str(seconds - tally.seconds)
        try:
            done = subprocess.run(
                [*command, name, left, str(seed)], stdout=subprocess.PIPE, timeout=HANG + seconds,
                stderr=subprocess.DEVNULL, check=False,
            )  # fmt: skip
            died = f"the process died ({done.returncode})" if done.returncode else ""
        except subprocess.TimeoutExpired:
            done, died = None, "the process hung"
        if done is not None and not died:
            tally.add(Tally(**json.loads(done.stdout)))
        else:
            tally.faults.append(died)
            tally.seconds += time.perf_counter() - begun
            for path in folder.glob("input.*"):
                _keep(path, died)
        seed += 1
    return tally


def _child(estimate: str, folder: str, name: str, seconds: str, seed: str) -> None:
    target = targets(Path(estimate).read_bytes())[name]
    tally = fuzz(target, PER_PROCESS, float(seconds), int(seed), Path(folder))
    print(json.dumps(asdict(tally)))


def main() -> None:
    """Try every target, or those that are named, and print what became of the files."""
    if sys.argv[1:2] == ["--child"]:
        return _child(*sys.argv[2:])
    parser = argparse.ArgumentParser(prog="python -m benchmarks.fuzz", description=__doc__)
    parser.add_argument("targets", nargs="*")
    parser.add_argument("--seconds", type=float, default=60.0, help="for each target")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keep", type=Path, default=Path("out/fuzz"), help="where faults are kept")
    arguments = parser.parse_args()
    estimate = made_estimate()
    known = targets(estimate)
    unknown = set(arguments.targets) - set(known)
    if unknown:
        parser.error(f"{', '.join(sorted(unknown))}: known are {', '.join(known)}")
    arguments.keep.mkdir(parents=True, exist_ok=True)
    (arguments.keep / "estimate.json").write_bytes(estimate)
    print("| reader | files | read | refused | faults | longest, s of processor | memory |")
    print("|---|---|---|---|---|---|---|")
    faults = 0
    for name in arguments.targets or known:
        tally = _in_processes(name, arguments.seconds, arguments.seed, arguments.keep)
        faults += len(tally.faults)
        print(
            f"| {name} | {tally.files} | {tally.read} | {tally.refused} | {len(tally.faults)} | "
            f"{tally.longest:.2g} | +{tally.growth:.0f} MB |",
            flush=True,
        )
        for fault, count in Counter(tally.faults).items():
            print(f"  {count} times: {fault}", file=sys.stderr)
    return sys.exit(1 if faults else 0)


if __name__ == "__main__":
    main()
