"""``flexid derive`` from the command line: text, notes, exit status."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from flexid.cli import main as cli


def flexid(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run the command in a process of its own."""
    command = [sys.executable, "-c", "from flexid.cli.main import main; main()", *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)


@pytest.mark.parametrize(
    ("target", "mark"),
    [
        ("latex", r"\dot{z}_{2} &= c_{2} r x_{4}"),
        ("python", "c2*r*x4,"),
        ("c", "rate[3] = c2*r*x4"),
    ],
)
def test_paper_is_printed(target: str, mark: str):
    """Assert that the last line of (6) comes out in every language, and nothing on stderr."""
    done = flexid("derive", "flexible-joint", "--to", target)
    assert (done.returncode, done.stderr) == (0, "")
    assert mark in done.stdout


def test_unknown_input_gain_is_reported_on_stderr():
    """Assert that the need of u' is said beside the equations, not in them."""
    done = flexid("derive", "flexible-joint", "--unknown-input-gain", "--to", "c")
    assert done.returncode == 0
    assert "u_rate" in done.stderr
    assert "note" not in done.stdout


def test_quadrature_is_reported_on_stderr(examples: Path):
    """Assert that the coefficient that is integrated numerically is named."""
    done = flexid("derive", str(examples / "models" / "stribeck.toml"))
    assert done.returncode == 0
    assert "stribeck; integrated numerically" in done.stderr


@pytest.mark.parametrize(
    ("name", "target"), [("pendulum", "latex"), ("three_inertias", "python"), ("stribeck", "c")]
)
def test_example_models_are_printed(
    name: str, target: str, examples: Path, capsys: pytest.CaptureFixture[str]
):
    """Assert that every example model is printed."""
    run_here("derive", str(examples / "models" / f"{name}.toml"), "--to", target, status=0)
    assert len(capsys.readouterr().out) > 200


def run_here(*arguments: str, status: int) -> None:
    """Run the command in this process and check its exit status."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["flexid", *arguments])
        with pytest.raises(SystemExit) as exited:
            cli.main()
    assert (exited.value.code or 0) == status


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("flexible-joint", "--terms", "joint_damping"), ("theta_damping", "x4", "least squares")),
        (("flexible-joint", "--terms", "magnets"), ("magnets", "gravity")),
        (("flexible-joint", "--to", "fortran"), ("fortran", "latex, python, c")),
        (("missing.toml",), ("missing.toml", "no such file")),
        (("model.toml", "--terms", "gravity"), ("terms: belongs",)),
        (("model.toml", "--unknown-input-gain"), ("unknown-input-gain: belongs",)),
    ],
)
def test_bad_input_is_one_sentence(
    arguments: tuple[str, ...], words: tuple[str, ...], capsys: pytest.CaptureFixture[str]
):
    """Assert exit status 2 and one line on stderr that names the place, without a traceback."""
    run_here("derive", *arguments, status=2)
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("flexid: ")
    assert captured.err.count("\n") == 1
    for word in words:
        assert word in captured.err


def test_hostile_model_is_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """Assert that code in a model file is named as not allowed and does not run."""
    file = tmp_path / "hostile.toml"
    trace = tmp_path / "trace"
    file.write_text(
        'name = "m"\n[[rows]]\nname = "a"\ncoordinate = "q"\nvelocity = "v"\n'
        f"[rows.coefficients]\np = \"__import__('pathlib').Path('{trace}').touch()\"\n"
    )
    run_here("derive", str(file), status=2)
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "hostile.toml" in error
    assert not trace.exists()


def test_the_document_has_text_and_notes(examples: Path):
    """Assert that --json holds the equations and what to know of them, and is nothing else."""
    done = flexid("derive", str(examples / "models" / "stribeck.toml"), "--to", "c", "--json")
    document = json.loads(done.stdout)
    assert document["to"] == "c"
    assert "rate[" in document["text"]
    assert "integrated numerically" in document["notes"][0]


def test_exported_files_are_listed(tmp_path: Path):
    """Assert that --json names the files that were written."""
    options = ("--to", "c99", "--sample-time", "0.001", "--out", str(tmp_path), "--json")
    done = flexid("export", "flexible-joint", *options)
    assert done.returncode == 0, done.stderr
    document = json.loads(done.stdout)
    assert {Path(path).name for path in document["files"]} == {p.name for p in tmp_path.iterdir()}
    assert document["files"]


def test_version_and_help():
    """Assert that --version prints the version and that no arguments print the help."""
    assert flexid("--version").stdout.startswith("flexid 0.")
    done = flexid()
    assert "derive" in done.stdout + done.stderr


def test_start_is_light():
    """Assert that the command line starts without SymPy, numba, polars and matplotlib."""
    code = (
        "import sys, flexid.cli.main; "
        "print([m for m in ('sympy', 'numba', 'polars', 'matplotlib') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
