"""Refusals of the command line: status 2, one sentence with the place, and no output."""

import shlex
import shutil
from pathlib import Path

import pytest
from tests.campaigns.tiny import EXPERIMENT, write_experiment

from flexid.arrays import to_json
from flexid.stored_estimates.estimate_file import estimate_document
from made_estimates import TRUE, exact

ROOT = Path(__file__).parents[2]
HEADER = "time [s],link_position [rad],motor_position [rad],motor_torque [N m]"
LOOP = EXPERIMENT.partition("[sampling]")[0].replace("[plant]", "[plant]\njoint_damping = 0.1")
DAMPED = f'[model]\nterms = ["gravity", "motor_viscous", "joint_damping"]\n{LOOP}'


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder with a valid file of each kind, and invalid ones."""
    folder = tmp_path_factory.mktemp("refused")
    write_experiment(folder / "tiny.toml")
    write_experiment(folder / "single.toml", campaign="")
    grid = '[campaign]\nkind = "grid"\nvary.observer.link = [1.0, 2.0]\n'
    write_experiment(folder / "damped.toml", grid, DAMPED)
    (folder / "a.json").write_text(to_json(estimate_document(exact(TRUE, "a"))))
    (folder / "empty").mkdir()
    log = (ROOT / "examples" / "flexible_joint.csv").read_text()
    texts = {
        "other.json": '{"model": "flexible"}',
        "good.csv": log,
        "again.csv": log,
        "ragged.csv": f"{HEADER}\n0,0,0,0\n0.1,1,1\n",
    }
    for name, text in texts.items():
        (folder / name).write_text(text)
    shutil.copy(ROOT / "experiments" / "huang2003.toml", folder)
    return folder


REFUSED = (
    ("campaign", "EXPERIMENT: is missing"),
    ("campaign tiny.toml", "--out: is missing"),
    ("campaign tiny.toml --summary out", "EXPERIMENT: does not go with summary"),
    ("campaign --summary out --workers 2", "--workers: does not go with summary"),
    ("campaign tiny.toml --out out --scheduler x --workers 2", "--workers: is for"),
    ("campaign single.toml --out out", "the key 'campaign' is missing"),
    ("campaign damped.toml --out rows", "needs the acceleration"),
    ("compare a.json other.json --out out", "is no estimate: give an estimate.json"),
    ("compare a.json empty --out out", "give the path of an estimate.json"),
    ("simulate a.json", "a.json: is JSON, like a saved estimate: give a TOML file"),
    ("derive flexible-joint --to fortran", "latex, python, c"),
    ("derive model.toml --terms gravity", "terms: is for flexible-joint"),
    ("derive model.toml --unknown-input-gain", "unknown-input-gain: is for flexible-joint"),
    ("identify ragged.csv --out out", "ragged.csv: line 3"),
    ("watch good.csv --memory 0.01", "give more than"),
    ("identify good.csv again.csv --stream", "only one log can be streamed"),
    ("reproduce --out good.csv", "--out"),
    ("identify --columns= good.csv", "--columns: its name is empty"),
    ("identify ''", "LOG: its name is empty"),
    ("export a.json --to mjcf --memory 5 --out out", "--memory: is for the online estimator"),
    ("export a.json --to c99 --sample-time 0.001 --terms gravity --out out", "--terms: is for"),
    ("identify good.csv --terms auto,gravity", "'auto' is unknown: there are gravity"),
    ("campaign tiny.toml --out out --workers 0", "--workers: must be at least 1, got 0"),
    ("simulate huang2003.toml --set controller.k", "path=number"),
    ("simulate huang2003.toml --out huang2003.toml", "cannot be written (file exists): name"),
    ("simulate huang2003.toml --csv", "nowhere to write"),
    ("studio missing.csv --no-browser --port 0", "missing.csv: there is no such file"),
    ("validate none.json good.csv", "none.json"),
    ("validate a.json good.csv --min-fit nan", "--min-fit: must be 100 % or less, got nan"),
    ("watch", "SOURCE: is missing"),
    ("watch udp://127.0.0.1:9000", "let another program write"),
    ("watch good.csv --hold cubic", "'cubic' is unknown: there are auto, linear, zero"),
    ("watch good.csv --every 0", "must be above 0 s, got 0.0"),
)


@pytest.mark.parametrize(("arguments", "said"), REFUSED, ids=[each for each, _ in REFUSED])
def test_a_refusal_is_one_sentence(flexid, folder, monkeypatch, arguments, said):
    """Assert that the error is named in one line, and that no file is written."""
    monkeypatch.chdir(folder)
    outcome = flexid(*shlex.split(arguments))
    assert outcome.status == 2
    assert outcome.stdout == ""
    (line,) = outcome.stderr.splitlines()
    assert line.startswith("flexid: ")
    assert said in line
    assert not (folder / "out").exists()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ("identify", "Missing argument 'LOG...'"),
        ("compare a.json", "Missing argument 'B'"),
        ("export a.json --out out", "Missing option '--to'"),
        ("export a.json --to mjcf", "Missing option '--out'"),
    ],
)
def test_what_is_missing_is_named_as_it_is_typed(flexid, folder, monkeypatch, arguments, said):
    """Assert that a usage error names the missing argument."""
    monkeypatch.chdir(folder)
    outcome = flexid(*shlex.split(arguments))
    assert (outcome.status, outcome.stdout) == (2, "")
    assert said in outcome.stderr
