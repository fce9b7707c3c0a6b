"""Fuzz test of all readers of flexid with damaged files.

    python -m benchmarks.fuzz [--guided] [--seconds 60] [--seed 1] [--keep FOLDER] [TARGET ...]

Each target is a reader with valid files. Bytes, lines, numbers, words of the format and encodings
are mutated. The reader may return, or raise a `FlexidError` of one line. A fault is any other
exception, a file that takes longer than the limit, or memory growth beyond the limit. Then the file
is kept, and the exit status is 1.

Formats for which flexid uses a child process are read without one, which is a thousand times as
fast. A file that ends the process is tried again as flexid reads it.

With --guided, atheris makes the files, from those that reached a new branch. With --write, a
reader's row in the table of `docs/reliability.md` is replaced when it is done; other rows do not
change.
"""

from __future__ import annotations

import argparse
import codecs
import json
import os
import random
import re
import subprocess
import sys
import time
import warnings
import zlib
from collections import Counter
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import asdict
from pathlib import Path

from benchmarks.fuzz_inside import readers_inside
from benchmarks.fuzz_table import GUIDED, MUTATED, Tally
from benchmarks.fuzz_targets import Target, Targets, made_estimate
from flexid.errors import FlexidError

LONGEST = 5.0  # s of processor time for one file, at most
HANG = 300.0  # s more, after which a process counts as hanging
PER_PROCESS = 5_000  # files
LARGEST = 300_000  # bytes of a mutated file
MOST_GROWTH = 500.0  # MB of memory, during the test of a target
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


def mutated(draw: random.Random, target: Target) -> bytes:
    """Return one of the target's files with a few mutations."""
    content = draw.choice(target.seeds)
    for _ in range(draw.randint(1, 4)):
        content = draw.choice(_MUTATIONS)(draw, content, target)
    return content[:LARGEST]


def _place(draw: random.Random, content: bytes) -> int:
    # Most of a format's structure is at the beginning of a file.
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
    """Try a reader with a file and return the fault.

    Returns
    -------
    str or None
        First line of a fault; empty if the file was read; None if it was refused.
    """
    path.write_bytes(content)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            target.read(path)
    except FlexidError as error:
        message = str(error)
        return None if message and "\n" not in message else f"message of lines: {message[:200]!r}"
    except BaseException as error:  # any exception but a `FlexidError` is a fault
        if isinstance(error, KeyboardInterrupt):
            raise
        return f"{type(error).__name__}: {error}".splitlines()[0][:200]
    return ""


def fuzz(target: Target, files: int, seconds: float, seed: int, folder: Path) -> Tally:
    """Try a reader up to a number of files or a time; faults are kept in `folder`."""
    draw = random.Random(seed)
    tally = Tally()
    before = _peak()
    start = time.perf_counter()
    path = folder / f"input{target.suffix}"
    tried(target, path, target.seeds[0])  # the first call compiles
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
    if tally.growth > MOST_GROWTH and not target.is_apart:  # a child process has its own limit
        tally.faults.append(f"memory grew by {tally.growth:.0f} MB")
    return tally


def _count_crash(target: Target, path: Path, died: str, tally: Tally) -> None:
    """Count the file that ended a process; it is a fault only if it ends flexid's process, too."""
    fault = tried(target, path, path.read_bytes()) if target.is_apart else died
    tally.read += fault == ""
    tally.refused += fault is None
    if fault:
        tally.faults.append(fault)
        _keep(path, fault)


def _keep(path: Path, fault: str) -> None:
    """Keep the file that caused a fault."""
    kept = path.with_name(f"{zlib.crc32(path.read_bytes()):08x}{path.suffix}")
    path.replace(kept)
    print(f"  {kept}: {fault}", file=sys.stderr)


def _peak() -> float:
    """Return the largest resident memory of the process so far, in MB; zero if unknown."""
    status = Path("/proc/self/status")  # getrusage includes the parent's memory
    if not status.exists():
        return 0.0
    return int(status.read_text().partition("VmHWM:")[2].split()[0]) / 1e3


def _in_processes(name: str, seconds: float, seed: int, keep: Path) -> Tally:
    """Try a reader in processes of a few thousand files each, so that a crash is noticed."""
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
            tally.seconds += time.perf_counter() - begun
            for path in folder.glob("input.*"):
                _count_crash(Targets(estimate.read_bytes())[name], path, died, tally)
        seed += 1
    return tally


def _guided(name: str, seconds: float, seed: int, keep: Path) -> Tally:
    """Let atheris try a reader in a separate process, until a fault."""
    folder = keep / re.sub(r"\W+", "-", name)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "tally.json").write_text('{"read": 0, "refused": 0}')
    command = [sys.executable, "-m", "benchmarks.fuzz_guided", str(keep / "estimate.json")]
    options = (
        f"-max_total_time={seconds:.0f} -seed={seed} -timeout={HANG:.0f} -rss_limit_mb=2500 "
        f"-max_len={LARGEST} -len_control=20 -print_final_stats=1 -artifact_prefix={folder}/"
    )
    begun = time.perf_counter()
    done = subprocess.run(
        [*command, str(folder), name, *options.split()],
        capture_output=True, text=True, errors="replace", check=False,
        env={**os.environ, "MALLOC_PERTURB_": "165"},  # shows reads of uninitialised memory
    )  # fmt: skip
    output = done.stdout + done.stderr
    (folder / "log.txt").write_text(output)
    runs = re.findall(r"#(\d+)\s.*cov: (\d+)", done.stderr)
    counts = json.loads((folder / "tally.json").read_text())
    tally = Tally(read=counts["read"], seconds=time.perf_counter() - begun)
    if not runs:
        tally.faults.append(f"atheris did not run, see {folder / 'log.txt'}")
        return tally
    files, tally.branches = map(int, runs[-1])
    tally.refused = files - tally.read
    tally.growth = max(map(float, re.findall(r"rss: (\d+)Mb", done.stderr)))
    left = [path for path in folder.iterdir() if re.match("(crash|timeout|oom)-", path.name)]
    target = Targets((keep / "estimate.json").read_bytes())[name]
    if left and target.is_apart:  # in flexid a crash ends only a child process
        path = folder / f"input{target.suffix}"
        faults = [tried(target, path, one.read_bytes()) for one in left]
        tally.faults += [fault for fault in faults if fault]
    elif done.returncode:
        found = re.findall(r"FoundError: (.*)|ERROR: libFuzzer: (.*)", output)
        fault = next(filter(None, found[0]), "") if found else f"exit status {done.returncode}"
        tally.faults.append(fault)
    return tally


def _child(estimate: str, folder: str, name: str, seconds: str, seed: str) -> None:
    target = Targets(Path(estimate).read_bytes())[name]
    with readers_inside() if target.is_apart else nullcontext():
        tally = fuzz(target, PER_PROCESS, float(seconds), int(seed), Path(folder))
    print(json.dumps(asdict(tally)))


def main() -> None:
    """Try all targets or the named ones, and print the results."""
    if sys.argv[1:2] == ["--child"]:
        return _child(*sys.argv[2:])
    parser = argparse.ArgumentParser(prog="python -m benchmarks.fuzz", description=__doc__)
    parser.add_argument("targets", nargs="*")
    parser.add_argument("--seconds", type=float, default=60.0, help="for each target")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keep", type=Path, default=Path("out/fuzz"), help="where faults are kept")
    parser.add_argument("--guided", action="store_true", help="let atheris make the files")
    parser.add_argument("--write", action="store_true", help="into docs/reliability.md")
    arguments = parser.parse_args()
    estimate = made_estimate()
    known = Targets(estimate)
    unknown = set(arguments.targets) - set(known)
    if unknown:
        parser.error(f"{', '.join(sorted(unknown))}: known are {', '.join(known)}")
    arguments.keep.mkdir(parents=True, exist_ok=True)
    (arguments.keep / "estimate.json").write_bytes(estimate)
    one, table = (_guided, GUIDED) if arguments.guided else (_in_processes, MUTATED)
    print("\n".join(table.head))
    faults = 0
    for name in arguments.targets or known:
        tally = one(name, arguments.seconds, arguments.seed, arguments.keep)
        faults += len(tally.faults)
        row = table.row(name, tally)
        print(row, flush=True)
        for fault, count in Counter(tally.faults).items():
            print(f"  {count} times: {fault}", file=sys.stderr)
        if arguments.write:
            table.write(row, known)
    return sys.exit(1 if faults else 0)


if __name__ == "__main__":
    main()
