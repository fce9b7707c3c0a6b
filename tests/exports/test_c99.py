"""The estimator in C99: its results, settings, refusals, and warnings of compilers."""

import dataclasses
import re
import shutil
import subprocess
from functools import partial
from math import nan
from pathlib import Path

import polars as pl
import pytest
from benchmarks.drive import QEMU, TARGET, build
from drive import CASES, DRIVES, HERE, LOG, MAIN, PRECISIONS, STRICT, compiled, run, tool

import flexid
from flexid.errors import SettingError
from flexid.exports.c99 import DriveSource
from flexid.exports.fmu import plant_of
from flexid.exports.request import (
    EstimatorSettings,
    ExportRequest,
    doubts_of,
    rendered,
    request_of_identification,
)

precisions = pytest.mark.parametrize("precision", PRECISIONS)

SANITIZERS = "-fsanitize=address,undefined,float-divide-by-zero"
BUILDS = {
    "gcc": ("gcc",),
    "clang": ("clang",),
    "sanitizers": ("gcc", "-g", SANITIZERS, "-fno-sanitize-recover=all"),
}
OTHERS = {
    "friction": {"sample_time": 1e-3, "terms": ("gravity", "link_coulomb", "motor_coulomb")},
    "offset": {"sample_time": 1e-3, "terms": ("gravity", "gravity_cosine", "link_offset")},
    # Gravity acts, but is not among the terms; forgetting then matters more.
    "a term that is missing": {"log": LOG, "terms": ("motor_viscous",), "memory": 2.0},
}


@pytest.fixture(scope="module")
def drives(tmp_path_factory) -> dict[str, Path]:
    """Return directories of every kind of exported estimator, written once."""
    folder = tmp_path_factory.mktemp("drives")
    for number, options in enumerate(DRIVES.values()):
        flexid.export("flexible-joint", to="c99", out=folder / str(number), **options)
    return {name: folder / str(number) for number, name in enumerate(DRIVES)}


thorough = partial(pytest.param, marks=pytest.mark.thorough)
REPLAYS = [
    *(("gcc", name, precision) for name in DRIVES for precision in PRECISIONS),
    *(thorough("clang", *case) for case in ((MAIN, "double"), *((n, "float") for n in DRIVES))),
    ("sanitizers", MAIN, "double"),
    *(thorough("sanitizers", name, "float") for name in DRIVES),
    *(thorough("gcc", name, precision) for name in OTHERS for precision in PRECISIONS),
]


@pytest.mark.parametrize(("build", "name", "precision"), REPLAYS)
def test_replay_agrees_with_python(drives, tmp_path, build, name, precision):
    """Assert compilation without warnings, and Python's estimates, to 2e-5 in float."""
    if name in OTHERS:
        flexid.export("flexible-joint", to="c99", out=tmp_path / "other", **OTHERS[name])
    directory = tmp_path / "other" if name in OTHERS else drives[name]
    compiler, *flags = BUILDS[build]
    program = compiled(compiler, directory, *flags, PRECISIONS[precision], out=tmp_path / "drive")
    (difference,) = re.findall(r"difference to Python (\S+)", run(program))
    assert name != MAIN or float(difference) < 2e-5


@precisions
def test_replay_on_cortex_m4f(drives, tmp_path, precision):
    """Assert agreement on a microcontroller with single-precision hardware."""
    tool("arm-none-eabi-gcc")
    qemu, program = tool(QEMU[0]), tmp_path / "drive.elf"
    main, options = str(drives[MAIN] / "example_main.c"), (*STRICT, "-O2", PRECISIONS[precision])
    build(drives[MAIN], main, options, program)
    printed = run(qemu, *QEMU[1:], "-kernel", program, timeout=120.0)
    assert "health 1, difference" in printed


WRONG = (
    ("theta2 = state->row[0].unknown[1]", "theta2 = state->row[0].unknown[1]*REAL(1.001)"),
    ("theta1 = state->row[0].unknown[0]", "theta1 = REAL(0.0) / REAL(0.0)"),
)
WRONG_POLE = ("#define POLE REAL(0.98019", "#define POLE REAL(0.98018")  # invisible in float


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("precision", "right", "wrong"),
    [*((precision, *pair) for pair in WRONG for precision in PRECISIONS), ("double", *WRONG_POLE)],
)
def test_what_is_wrong_is_noticed(drives, tmp_path, precision, right, wrong):
    """Assert that the example detects a wrong coefficient or filter."""
    directory = tmp_path / "wrong"
    shutil.copytree(drives[MAIN], directory)
    source = directory / "flexid_drive.c"
    assert right in source.read_text()
    source.write_text(source.read_text().replace(right, wrong))
    program = compiled("gcc", directory, PRECISIONS[precision], out=tmp_path / "drive")
    with pytest.raises(AssertionError, match="difference to Python"):
        run(program)


@pytest.mark.parametrize("name", DRIVES)
def test_nothing_but_mathematics_is_called(drives, tmp_path, name):
    """Assert that a float build calls float functions of math.h, and nothing else."""
    run(
        *(tool("arm-none-eabi-gcc"), *TARGET, *STRICT, "-O2", "-DFLEXID_FLOAT"),
        # Otherwise the compiler replaces loops by memset and memcpy.
        "-fno-tree-loop-distribute-patterns",
        *("-c", drives[name] / "flexid_drive.c", "-o", tmp_path / "drive.o"),
    )
    symbols = run(tool("arm-none-eabi-nm"), "--undefined-only", tmp_path / "drive.o")
    called = {line.split()[-1] for line in symbols.splitlines()}
    assert called <= {"sinf", "sqrtf", "tanhf"}


def test_any_c_plus_plus_takes_the_header(drives, tmp_path):
    """Assert that the header can be included from C++."""
    main = tmp_path / "main.cpp"
    main.write_text('#include "flexid_drive.h"\nint main() { flexid_state s; flexid_init(&s); }\n')
    run(
        *(tool("gcc"), "-std=c99", "-c", drives[MAIN] / "flexid_drive.c"),
        *("-o", tmp_path / "drive.o"),
    )
    run(
        *(tool("g++"), "-Wall", "-Wextra", "-Werror", f"-I{drives[MAIN]}", main),
        *(tmp_path / "drive.o", "-lm", "-o", tmp_path / "main"),
    )


cases = pytest.mark.parametrize(("name", "precision"), CASES)

DEVIATIONS = {
    "misra-c2012-8.7": "flexid_drive.h's functions are called from elsewhere",
    "misra-c2012-20.10": "## gives literals the suffix of their type",
}
"""Rules of MISRA C:2012 that are violated, each with its reason."""


@cases
def test_the_fuzzer_finds_nothing(drives, tmp_path, name, precision):
    """Assert that arbitrary bytes as samples cause neither a crash nor a NaN estimate."""
    program, probe = tmp_path / "fuzz", tmp_path / "probe.c"
    probe.write_text(
        "int LLVMFuzzerTestOneInput(void); int LLVMFuzzerTestOneInput(void) { return 0; }"
    )
    command = [tool("clang"), "-fsanitize=fuzzer,address", probe, "-o", tmp_path / "probe"]
    if "libclang_rt" in subprocess.run(command, capture_output=True, text=True).stderr:
        pytest.skip("libclang-rt-dev is not installed")
    run(
        *(tool("clang"), "-std=c99", "-g", "-O1", SANITIZERS.replace("=", "=fuzzer,", 1)),
        *("-fno-sanitize-recover=all", PRECISIONS[precision], f"-I{drives[name]}"),
        *(drives[name] / "flexid_drive.c", HERE / "fuzz.c", "-lm", "-o", program),
    )
    run(program, "-seed=1", "-runs=1000", "-max_len=8000", cwd=tmp_path)


@cases
def test_misra(drives, name, precision):
    """Assert that cppcheck finds nothing but the stated deviations from MISRA C:2012."""
    found = run(
        *(tool("cppcheck"), "--std=c99", "--enable=all", "--inconclusive", "--addon=misra"),
        *("--suppress=missingIncludeSystem", "--suppress=unusedFunction", "--quiet"),
        *(PRECISIONS[precision], "flexid_drive.c"),
        cwd=drives[name],
    )
    rules = set(re.findall(r"\[([\w.-]+)\]$", found, re.MULTILINE))
    assert rules <= set(DEVIATIONS), found


@pytest.mark.thorough
def test_eva_raises_no_alarm(drives):
    """Assert that Eva proves memory and integers safe, for any bytes in state and sample."""
    frama_c = tool("frama-c")
    libc = Path(run(frama_c, "-print-share-path").strip()) / "libc"
    found = run(
        *(frama_c, "-eva", "-eva-precision", "3", "-eva-no-show-progress"),
        *("-warn-special-float", "none", "-machdep", "gcc_x86_64"),
        f"-cpp-extra-args=-I{drives[MAIN]} -I{libc} -DFLEXID_FLOAT",
        *(drives[MAIN] / "flexid_drive.c", HERE / "eva.c", libc / "math.c"),
    )
    summary = found.partition("[eva:summary]")[2]
    assert "0 alarms generated by the analysis" in summary, found[-3000:]
    assert re.search(r"(\d+) functions analyzed \(out of \1\): 100% coverage", summary), summary


SETTINGS = EstimatorSettings(1e-3)


def arm(regressors, name="arm", **options):
    """Return a model of one row."""
    row = flexid.Row(name, "q", "v", regressors, "u")
    return flexid.ParametricSystem("model", (row,), **options)


def test_names_that_are_taken_are_renamed(tmp_path):
    """Assert that coefficients and constants with reserved names compile, with equal estimates."""
    taken = {"FLEXID_ROWS": "sin(q)", "POLE": "q", "uint32_t": "cos(q)"}
    regressors = {name: f"-{name}_2*{shape}" for name, shape in taken.items()}
    constants = {f"{name}_2": 2.0 for name in taken}
    model = arm({**regressors, "viscous": "-v"}, constants=constants)
    flexid.export(model, to="c99", sample_time=1e-3, out=tmp_path / "drive")
    printed = run(compiled("gcc", tmp_path / "drive", out=tmp_path / "run"))
    assert all(f"{name.lower()}_ = " in printed for name in taken)


def test_odd_models():
    """Assert at most as many coefficients as bits of a mask, and names that end no comment."""
    rows = [{f"c{i}": f"sin({i + 1}*q)" for i in range(count)} for count in (31, 32)]
    assert "row[0].unknown[30]" in DriveSource(ExportRequest(arm(rows[0])), SETTINGS).source()
    with pytest.raises(SettingError, match="arm: has 32 coefficients"):
        DriveSource(ExportRequest(arm(rows[1])), SETTINGS)
    model = arm({"gravity": "-sin(q)"}, "arm *\\\n/ int evil; /*")
    drive = DriveSource(ExportRequest(model), SETTINGS)
    unit = plant_of(ExportRequest(model, {"gravity": 1.0}))
    for text in (drive.header(), drive.source(), unit.source, rendered("fmu/plant.h", plant=unit)):
        assert "\\\n/" not in text
        assert "\n/ int" not in text


@pytest.fixture(scope="module")
def result(example_estimate):
    """Return an identification of the example."""
    return example_estimate.result


def doubted(result, name="alpha2", **changes):
    """Return the identification with one coefficient changed."""
    coefficient = dataclasses.replace(result.coefficients[name], **changes)
    return dataclasses.replace(result, coefficients=result.coefficients | {name: coefficient})


def test_what_is_exported_of_an_estimate(result):
    """Assert the log's units, and that unknown values are named instead of taken as 0."""
    whole = request_of_identification(result)
    assert set(whole.values) == set(result.coefficients)
    source = request_of_identification(doubted(result, value=nan))
    assert set(source.values) == set(result.coefficients) - {"alpha2"}
    assert "alpha2" in source.system.coefficients
    units = (whole.units[name] for name in ("u", "theta2", "beta1"))
    assert tuple(units) == ("N m", "1/s^2", "rad/s^2/(N m)")
    current = doubted(result, "beta1", unit="rad/s^2/A")
    assert request_of_identification(current).units["u"] == "A"
    assert doubts_of(result.coefficients) == ()
    (doubt,) = doubts_of(doubted(result, verdict="undetermined").coefficients)
    assert doubt == "the estimate leaves alpha2 undetermined"


REFUSED = {
    "no sample time": {},
    "no number": {"sample_time": nan},
    "too short": {"sample_time": 1e-9},
    "negative": {"sample_time": -1e-3},
    "too long": {"sample_time": 2.0},
    **{
        f"a filter of {rate}": {"sample_time": 1e-3, "filter_rate": rate}
        for rate in (0.009, 501.0, -20.0)
    },
    "too short a memory": {"sample_time": 1e-3, "memory": 0.0},
    "another sample time": {"sample_time": 2e-3, "log": LOG},
    "another machine": {"what": "examples/models/pendulum.toml", "log": LOG},
}


def test_what_no_drive_has_is_refused(result, tmp_path, refusals):
    """Assert that invalid settings are refused in one sentence, and that no file is left."""
    calls = {}
    for name, options in REFUSED.items():
        given = {"what": "flexible-joint", "to": "c99", "out": tmp_path / "drive"} | options
        calls[name] = partial(flexid.export, **given)
    for name in ("theta2", "alpha1", "beta1"):
        for value in (0.0, -100.0):
            other = doubted(result, name, value=value)
            calls[f"{name} = {value}"] = partial(request_of_identification, other)
    refusals(calls)
    assert not (tmp_path / "drive").exists()


def test_a_log_of_another_input_is_refused(tmp_path):
    """Assert that a log of a current is refused as test vector of an estimate from a torque."""
    log = pl.read_csv("examples/flexible_joint.csv").head(2000)
    terms = ("gravity", "motor_viscous")
    estimate = flexid.identify(log, terms=terms, hold="zero", input_delay=0, link_delay=0)
    current = log.rename({"motor_torque [N m]": "motor_current [A]"})
    with pytest.raises(SettingError, match="input in A, and the estimate was made with one in N m"):
        flexid.export(estimate, to="c99", out=tmp_path / "drive", log=current)
    names = ["README.md", "example_main.c", "flexid_drive.c", "flexid_drive.h", "test_vector.h"]
    alone = log.drop("motor_torque [N m]")  # as the log of an estimate of the link alone
    for own in (log, alone):
        found = estimate if own is log else flexid.identify(alone, terms=["gravity"])
        written = flexid.export(found, to="c99", out=tmp_path / "drive", log=own)
        assert [path.name for path in written.paths] == names
