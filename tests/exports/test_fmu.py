"""The plant as FMUs: valid, compilable anywhere, with Python's trajectories."""

# FMPy's return types depend on the version of FMI, which it does not declare.
# pyright: reportOptionalMemberAccess=false, reportArgumentType=false

import os
import shutil
import sys
import zipfile
from functools import partial
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest
from drive import HERE, run, tool
from fmpy.build import build_platform_binary
from fmpy.fmi1 import FMICallException
from fmpy.validation import validate_fmu

import flexid
from flexid.errors import SettingError
from flexid.exports.fmu import write as write_fmu
from flexid.exports.request import ExportRequest
from flexid.simulation.free_run import free_run

TRUE = {"theta1": 5.0, "theta2": 100.0, "theta_cubic": 30.0, "alpha1": 400.0, "alpha2": 1.5}
TRUE |= {"alpha_coulomb": 0.4, "alpha_cubic": 120.0, "beta1": 4.0}
STEP = 1e-3


JOINT = flexid.flexible_joint(("gravity", "motor_viscous", "motor_coulomb", "cubic_stiffness"))
PAPER = flexid.flexible_joint(known={"beta1": 4.0})
PLAIN = ExportRequest(PAPER, {name: TRUE[name] for name in PAPER.coefficients})


@pytest.fixture(scope="module")
def units(tmp_path_factory):
    """Return FMUs of a joint with powers and friction, and the messages of their export."""
    tool("gcc")
    directory = tmp_path_factory.mktemp("units")
    known = {"theta2": "1/s^2", "beta1": "rad/s^2/(N m)", "u": "N m", "coulomb_velocity": "rad/s"}
    return directory, write_fmu(ExportRequest(JOINT, TRUE, known), directory)


def torque(time):
    """Return a torque of two tones."""
    return 12 * np.sin(3 * time) + 6 * np.sin(17 * time)


def simulated(unit, time, outputs, **options):
    """Return trajectories of an FMU under that torque, shape (n, n_outputs)."""
    found = fmpy.simulate_fmu(
        str(unit),
        stop_time=time[-1],
        step_size=STEP,
        output_interval=STEP,
        input=np.rec.fromarrays([time, torque(time)], names="time,u"),
        output=list(outputs),
        **options,
    )
    return np.array([found[name] for name in outputs]).T


@pytest.mark.parametrize("version", [2, 3])
def test_the_plant_moves_as_in_python(units, version):
    """Assert that the FMU is valid and moves as the free run with a held input, from any start."""
    time = STEP * np.arange(1500)
    unit = units[0] / f"plant_fmi{version}.fmu"
    assert validate_fmu(str(unit)) == []
    states = ("x1", "x2", "x3", "x4")
    start = {"x1": 0.2, "x3": 0.1}
    found = simulated(unit, time, states, start_values=start)
    own = free_run(JOINT, TRUE, np.array([0.2, 0, 0.1, 0]), torque(time), STEP, "zero")
    np.testing.assert_allclose(found, own, atol=1e-9)
    softer = {"theta2": 50.0, "coulomb_velocity": 0.5}
    found = simulated(unit, time, states, start_values=softer)
    other = JOINT.with_constants({"coulomb_velocity": 0.5})
    own = free_run(other, TRUE | {"theta2": 50.0}, np.zeros(4), torque(time), STEP, "zero")
    # Other values have other poles, and possibly another number of steps.
    np.testing.assert_allclose(found, own, atol=1e-7)


@pytest.mark.thorough
@pytest.mark.parametrize("version", [2, 3])
def test_fmpy_compiles_the_sources(units, version, tmp_path, monkeypatch):
    """Assert that an importer can build the same plant from the sources alone."""
    tool("make")
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}:{os.environ['PATH']}")  # for CMake
    unit, bare = units[0] / f"plant_fmi{version}.fmu", tmp_path / "bare"
    (tmp_path / "build").mkdir()
    with zipfile.ZipFile(unit) as whole:
        sources = [name for name in whole.namelist() if not name.startswith("binaries")]
        whole.extractall(bare, sources)
    build_platform_binary(bare, tmp_path / "build", "Unix Makefiles")
    assert list((bare / "binaries").glob("*/plant.*"))
    time = STEP * np.arange(200)
    compiled, here = (simulated(one, time, ("x1", "x3")) for one in (bare, unit))
    np.testing.assert_allclose(compiled, here, atol=1e-12)


@pytest.mark.thorough
@pytest.mark.parametrize("compiler", ["gcc", "clang"])
@pytest.mark.parametrize("version", [2, 3])
def test_its_sources_leave_compilers_silent(units, version, compiler, tmp_path):
    """Assert that sources are C99 without warnings, and link with a prefix for static use."""
    with zipfile.ZipFile(units[0] / f"plant_fmi{version}.fmu") as unit:
        unit.extractall(tmp_path)
    strict = ("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Wconversion", "-Werror")
    files = sorted((tmp_path / "sources").glob("*.c"))
    prefix = f"-DFMI{version}_FUNCTION_PREFIX=my_"
    library = tmp_path / "unit.so"
    run(tool(compiler), *strict, "-fPIC", "-shared", prefix, *files, "-o", library, "-lm")
    symbols = run(tool("nm"), "-D", "--defined-only", library)
    assert f"my_fmi{version}DoStep" in symbols
    assert f"my_fmi{version}GetVersion" in symbols


@pytest.mark.thorough
def test_nothing_it_is_given_breaks_it(units, tmp_path):
    """Assert that extreme inputs and steps pass the sanitizers, without a memory leak."""
    with zipfile.ZipFile(units[0] / "plant_fmi3.fmu") as unit:
        unit.extractall(tmp_path)
    shutil.copy(HERE / "fmi3_driver.c", tmp_path / "sources")
    own = [f for f in (tmp_path / "sources").glob("*.c") if f.name != "fmi3.c"]
    checked = ("-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
    run(tool("gcc"), "-std=c99", *checked, *own, "-o", tmp_path / "driver", "-lm")
    assert "steps" in run(tmp_path / "driver")


def opened(unit, folder, guid=None):
    """Return an initialised FMU, its value references by name, and two functions."""
    fmpy.extract(str(unit), str(folder))
    described = fmpy.read_model_description(str(unit))
    described.guid = guid or described.guid
    slave: Any = fmpy.instantiate_fmu(str(folder), described, "CoSimulation")
    if described.fmiVersion == "2.0":
        slave.setupExperiment(startTime=0.0)
    slave.enterInitializationMode()
    slave.exitInitializationMode()
    places = {v.name: v.valueReference for v in described.modelVariables}
    if described.fmiVersion == "2.0":
        return slave, places, slave.getReal, slave.setReal
    return slave, places, slave.getFloat64, slave.setFloat64


@pytest.mark.parametrize("version", [2, 3])
def test_a_kept_state_goes_on_as_it_was(units, version, tmp_path):
    """Assert that a restored plant repeats itself to the bit, and that a reset one restarts."""
    slave, places, get, put = opened(units[0] / f"plant_fmi{version}.fmu", tmp_path)
    keep, restore, free = (
        getattr(slave, f"{verb}FMU{'State' if version == 3 else 'state'}")
        for verb in ("get", "set", "free")
    )
    kept, reached = keep(), []
    for _ in range(2):
        assert get([places["x4"], 0]) == [0.0, 0.0]
        put([places["u"]], [7.0])
        for number in range(50):
            slave.doStep(number * STEP, STEP)
        reached.append(get([places["x1"], places["x4"]]))
        restore(kept)
    assert reached[0] == reached[1] != [0.0, 0.0]
    free(kept)
    slave.reset()
    assert get([places["x4"], places["u"]]) == [0.0, 0.0]
    slave.terminate()
    slave.freeInstance()


@pytest.mark.parametrize("version", [2, 3])
def test_what_cannot_be_is_refused(units, version, tmp_path):
    """Assert that backward steps, unknown variables and another token are errors."""
    plant, places, get, put = opened(units[0] / f"plant_fmi{version}.fmu", tmp_path / "plant")
    for wrong in (
        lambda: plant.doStep(0.0, -STEP),
        lambda: put([places["x1"]], [1.0]),  # after the initialisation
        lambda: get([999]),
        lambda: put([0], [1.0]),
    ):
        with pytest.raises(FMICallException):
            wrong()
    put([places["alpha1"]], [-1e9])
    put([places["u"]], [1e9])
    with pytest.raises(FMICallException):
        plant.doStep(0.0, 1.0)
    plant.freeInstance()
    with pytest.raises(Exception, match=r"[Ii]nstantiate"):
        opened(units[0] / f"plant_fmi{version}.fmu", tmp_path / "again", "{another}")


def test_what_it_lacks_is_said(units, tmp_path, monkeypatch):
    """Assert that smoothed friction and a missing compiler are refused in one sentence."""
    assert [w for w in units[1] if "coulomb_velocity" in w] == units[1]
    system = flexid.flexible_joint(("motor_stribeck",), known={"beta1": 4.0})
    values = {"theta2": 100.0, "alpha1": 400.0, "alpha_stribeck": 0.5}
    warnings = write_fmu(ExportRequest(system, values), tmp_path)
    assert any("coulomb_velocity" in w for w in warnings)
    described = fmpy.read_model_description(str(tmp_path / "plant_fmi3.fmu"))
    assert "coulomb_velocity" in {v.name for v in described.modelVariables}
    monkeypatch.setattr(shutil, "which", lambda _: None)
    (tmp_path / "bare").mkdir()
    (said,) = write_fmu(PLAIN, tmp_path / "bare")
    assert "only sources" in said
    names = sorted(path.name for path in (tmp_path / "bare").iterdir())
    assert names == ["plant_fmi2.fmu", "plant_fmi3.fmu"]
    for name in names:
        content = zipfile.ZipFile(tmp_path / "bare" / name).namelist()
        assert "sources/plant.c" in content
        assert not [path for path in content if path.startswith("binaries")]


FAILURES = {
    "a warning and an error": (
        "echo 'model.h:1: warning: hm' >&2; echo 'plant.c:9: error: no such thing' >&2; exit 1",
        r"cc cannot compile it \(model.h:1: warning: hm plant.c:9: error: no such thing\)",
    ),
    "a signal": ("kill -9 $$", r"cannot compile it \(.*SIGKILL"),
    "no library": ("exit 0", r"cannot compile it \(.*No such file"),
}


@pytest.mark.skipif(sys.platform != "linux", reason="the compilers are shell scripts")
@pytest.mark.parametrize("kind", FAILURES)
def test_a_compiler_that_fails_is_quoted(tmp_path, monkeypatch, kind):
    """Assert that a compiler's error is quoted unchanged."""
    script, words = FAILURES[kind]
    program = tmp_path / "cc"
    program.write_text(f"#!/bin/sh\n{script}\n")
    program.chmod(0o755)
    monkeypatch.setattr(shutil, "which", lambda _: str(program))
    with pytest.raises(SettingError, match=words):
        write_fmu(PLAIN, tmp_path)


def test_names_that_it_has_itself_and_missing_values_are_refused(tmp_path, refusals):
    """Assert that a state called time, and a plant without values, are refused."""
    row = flexid.Row("arm", "time", "v", {"stiffness": "-time"}, "u")
    odd = ExportRequest(flexid.ParametricSystem("odd", (row,)), {"stiffness": 1.0})
    some = {name: value for name, value in TRUE.items() if name != "alpha2"}
    cases = {"a state called time": odd, "bare": ExportRequest(JOINT)}
    cases["a value missing"] = ExportRequest(JOINT, some)
    refusals({name: partial(write_fmu, one, tmp_path) for name, one in cases.items()})
