"""Memory and instructions of the exported C on a Cortex-M4F, and ten minutes of fuzzing.

``python -m benchmarks.drive [--fuzz SECONDS]`` writes both into ``docs/export.md``. It needs the
Debian packages gcc-arm-none-eabi, libnewlib-arm-none-eabi, qemu-system-arm, clang and
libclang-rt-14-dev.
"""

import argparse
import re
import subprocess
import tempfile
from collections import Counter
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import flexid
from benchmarks.page_block import write_block
from benchmarks.size import sized

PAGE = Path("docs/export.md")
TESTS = Path("tests/exports")
BOARD = TESTS / "cortex_m"
TARGET = ("-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16")
COMPILE = ("arm-none-eabi-gcc", *TARGET, "-std=c99", "-fno-math-errno", "-g")
QEMU = ("qemu-system-arm", "-M", "mps2-an386", "-nographic", "-monitor", "none")
QEMU += ("-serial", "none", "-semihosting-config", "enable=on,target=native")

LOG = "examples/flexible_joint.csv"
CASES = [("float", "-O2"), ("float", "-Os"), ("double", "-O2")]
DEFINITION = {"float": "-DFLEXID_FLOAT", "double": "-UFLEXID_FLOAT"}


class Cost(NamedTuple):
    """Memory in bytes, and instructions of a step."""

    flash: int
    state: int
    stack: int
    mean: int
    most: int
    bound: int
    unseen: int


def run(*command: str | Path) -> str:
    done = subprocess.run([*map(str, command)], capture_output=True, text=True, check=True)
    return done.stdout


def cost(directory: Path, options: tuple[str, ...]) -> Cost:
    source, program = directory / "flexid_drive.c", directory / "drive.elf"
    run(*COMPILE, *options, "-c", source, "-o", directory / "drive.o")
    text = run("arm-none-eabi-size", directory / "drive.o").splitlines()[1].split()[0]
    build(directory, "measure_main.c", options, program)
    _, mean, most, stack, state = map(
        int, run(*QEMU, "-icount", "shift=10", "-kernel", program).split()
    )
    build(directory, "trace_main.c", options, program)
    bound, unseen = bound_of(program)
    return Cost(int(text), state, stack, mean, most, bound, unseen)


def build(directory: Path, main: str, options: tuple[str, ...], program: Path) -> None:
    run(
        *(*COMPILE, *options, "--specs=rdimon.specs", "-T", BOARD / "mps2.ld", f"-I{directory}"),
        *(BOARD / "startup.c", BOARD / main, directory / "flexid_drive.c", "-lm", "-o", program),
    )


def bound_of(program: Path) -> tuple[int, int]:
    """Return an upper bound of instructions per step, and the number of instructions never run.

    The bound adds up the largest number of runs of each instruction in any step. Loop counts do
    not depend on the data, so no step runs an instruction more often. The bound leaves out those
    that never ran.
    """
    listing = run("arm-none-eabi-objdump", "-d", "--no-show-raw-insn", program)
    functions = {
        name: [int(line.split(":")[0], 16) for line in body.splitlines() if ":\t" in line]
        for name, body in re.findall(r"^\w+ <(\w+)>:\n((?:.+\n)*)", listing, re.MULTILINE)
    }
    entry = functions["flexid_step"][0]
    callers = {*functions["main"], *functions.get("replay", [])}
    command = [*QEMU, "-singlestep", "-d", "exec,nochain", "-D", "/dev/stdout", "-kernel", program]
    most: Counter[int] = Counter()
    current: Counter[int] | None = None
    with subprocess.Popen([*map(str, command)], stdout=subprocess.PIPE, text=True) as trace:
        assert trace.stdout is not None
        for line in islice(trace.stdout, sized(None, 200_000)):
            if not line.startswith("Trace"):
                continue
            place = int(line.split("/")[1], 16)
            if place == entry:
                current = Counter()
            elif place in callers and current is not None:
                most |= current  # maximum for each instruction
                current = None
            if current is not None:
                current[place] += 1
        trace.kill()
    own = [functions[name] for name in functions.keys() & own_functions(program)]
    unseen = sum(place not in most for places in own for place in places)
    return sum(most.values()), unseen


def own_functions(program: Path) -> set[str]:
    """Return the functions of the estimator that a step may call."""
    lines = run("arm-none-eabi-nm", program.with_suffix(".o")).splitlines()
    names = {line.split()[-1] for line in lines if line.split()[-2] in "tT"}
    return names - {"flexid_checksum", "flexid_restore", "flexid_estimates"}


def fuzzed(directory: Path, seconds: int) -> str:
    program = directory / "fuzz"
    run(
        *("clang", "-std=c99", "-g", "-O1", "-DFLEXID_FLOAT", f"-I{directory}"),
        *("-fsanitize=fuzzer,address,undefined,float-divide-by-zero", "-fno-sanitize-recover=all"),
        *(directory / "flexid_drive.c", TESTS / "fuzz.c", "-lm", "-o", program),
    )
    done = subprocess.run(
        [program, f"-max_total_time={seconds}", "-max_len=20000", "-seed=1"],
        cwd=directory,
        capture_output=True,
        text=True,
    )
    runs = re.findall(r"Done (\d+) runs", done.stderr)
    outcome = "nothing found" if done.returncode == 0 and runs else "A FAILURE"
    return f"{seconds} s, {int(runs[0]) if runs else 0:,} sequences of samples: {outcome}"


def table(costs: list[tuple[str, str, Cost]]) -> str:
    head = (
        "|number|flags|flash, bytes|state, bytes"
        "|stack, bytes|instructions per step, mean|most|bound|\n" + "|---" * 8 + "|\n"
    )
    return head + "".join(
        f"|{number}|`{flags}`|{c.flash}|{c.state}|{c.stack}|{c.mean}"
        f"|{c.most}|{c.bound}{f' + {c.unseen}' if c.unseen else ''}|\n"
        for number, flags, c in costs
    )


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.drive", description=__doc__)
    parser.add_argument("--fuzz", type=int, default=600, metavar="SECONDS")
    seconds: int = parser.parse_args().fuzz
    costs = []
    with tempfile.TemporaryDirectory() as folder:
        for number, (precision, flags) in enumerate(sized(CASES, CASES[:1])):
            directory = Path(folder) / str(number)
            flexid.export("flexible-joint", to="c99", out=directory, log=LOG)
            found = cost(directory, (flags, DEFINITION[precision]))
            costs.append((precision, flags, found))
            print(costs[-1])
        outcome = fuzzed(Path(folder) / "0", seconds)
        print(outcome)
    write_block(PAGE, "costs", table(costs))
    write_block(PAGE, "fuzzed", f"{outcome}.\n")


if __name__ == "__main__":
    main()
