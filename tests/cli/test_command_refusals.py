"""What a command refuses: exit status 2, one sentence that names the place, and nothing written."""

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
HOSTILE = """
name = "m"
[[rows]]
name = "a"
coordinate = "q"
velocity = "v"
[rows.coefficients]
p = "__import__('pathlib').Path('out').touch()"
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with a good file of each kind, and bad ones."""
    folder = tmp_path_factory.mktemp("refused")
    write_experiment(folder / "tiny.toml")
    write_experiment(folder / "single.toml", campaign="")
    grid = '[campaign]\nkind = "grid"\nvary.observer.link = [1.0, 2.0]\n'
    write_experiment(folder / "damped.toml", grid, DAMPED)
    (folder / "a.json").write_text(to_json(estimate_document(exact(TRUE, "a"))))
    shutil.copy(folder / "a.json", folder / "copy.json")
    (folder / "empty").mkdir()
    log = (ROOT / "examples" / "flexible_joint.csv").read_text()
    texts = {
        "other.json": '{"model": "flexible"}',
        "newer.json": '{"format_version": 99}',
        "hostile.toml": HOSTILE,
        "good.csv": log,
        "again.csv": log,
        "volts.csv": log.replace("motor_torque [N m]", "motor_voltage [V]"),
        "ragged.csv": f"{HEADER}\n0,0,0,0\n0.1,1,1\n",
        "unit.csv": f"{HEADER.replace('[rad]', '[furlong]', 1)}\n0,0,0,0\n",
        "column.csv": f"{HEADER.replace('motor_position', 'motor_poss')}\n0,0,0,0\n",
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
    ("campaign --summary nothing", "nothing holds no campaign"),
    ("campaign nothing.toml --out out", "nothing.toml: there is no such file"),
    ("campaign single.toml --out out", "the key 'campaign' is missing"),
    ("campaign damped.toml --out rows", "needs the acceleration"),
    ("compare a.json other.json --out out", "holds no estimate: give an estimate.json"),
    ("compare a.json newer.json --out out", "is of format 99"),
    ("compare a.json empty --out out", "give the path of an estimate.json"),
    ("compare a.json absent.json --out out", "there is no such file"),
    ("compare a.json copy.json --out out", "hold the same estimate: give two"),
    ("simulate a.json", "a.json: is JSON, as an estimate: give a file in TOML"),
    ("derive flexible-joint --terms magnets", "'magnets' is unknown"),
    ("derive flexible-joint --to fortran", "latex, python, c"),
    ("derive missing.toml", "missing.toml: there is no such file"),
    ("derive model.toml --terms gravity", "terms: belongs"),
    ("derive model.toml --unknown-input-gain", "unknown-input-gain: belongs"),
    ("derive hostile.toml", "hostile.toml"),
    ("identify bad.csv --out out", "bad.csv: there is no such file"),
    ("identify ragged.csv --out out", "ragged.csv: line 3"),
    ("identify unit.csv --out out", "furlong"),
    ("identify column.csv --out out", "motor_poss"),
    ("identify good.csv --known motor_inertia", "'motor_inertia' is no name=number"),
    (
        "identify good.csv --known beta1=5 --known motor_inertia=0.2",
        "follows from what else is known",
    ),
    ("identify good.csv --terms gravity,turbulence", "turbulence"),
    ("identify good.csv --columns nowhere.toml", "nowhere.toml"),
    ("identify volts.csv --known motor_inertia=0.3", "torque"),
    ("identify good.csv again.csv", "again.csv"),
    ("excitation good.csv again.csv", "again.csv"),
    ("identify good.csv --stream", "only a Parquet file can be streamed"),
    ("identify good.csv again.csv --stream", "only one log can be streamed"),
    ("reproduce --out good.csv", "--out"),
    ("reproduce --out=", "--out: its name is empty"),
    ("identify --columns= good.csv", "--columns: its name is empty"),
    ("identify ''", "LOG: its name is empty"),
    ("export a.json --to mjcf --memory 5 --out out", "--memory: is of an online estimator"),
    ("export a.json --to c99 --sample-time 2 --out out", "--sample-time: 2 s is outside"),
    ("export a.json --to c99 --sample-time 0.001 --terms gravity --out out", "--terms: belongs"),
    ("identify good.csv --terms auto,gravity", "'auto' is unknown: there are gravity"),
    ("identify good.csv --validation-share 1", "must lie above 0 and up to 0.8, got 1.0"),
    ("campaign tiny.toml --out out --workers 0", "--workers: must be at least 1, got 0"),
    ("simulate nowhere.toml", "nowhere.toml: there is no such file"),
    ("simulate huang2003.toml --set controller.kk=3", "did you mean controller.k"),
    ("simulate huang2003.toml --set controller.k", "path=number"),
    ("simulate huang2003.toml --set controller.k=nan", "finite number"),
    ("simulate huang2003.toml --set controller.k=1 --set controller.k=2", "twice"),
    ("simulate huang2003.toml --out huang2003.toml", "cannot be written (file exists): name"),
    ("simulate huang2003.toml --csv", "nowhere to write"),
    ("studio missing.csv --no-browser --port 0", "missing.csv: there is no such file"),
    ("validate none.json good.csv", "none.json"),
    ("validate good.csv good.csv", "good.csv"),
    ("validate a.json good.csv --min-fit nan", "--min-fit: must be 100 % or less, got nan"),
    ("watch", "SOURCE: is missing"),
    ("watch no.csv", "no such file"),
    ("watch udp://127.0.0.1:9000", "let another program write"),
    ("watch good.csv --terms magic", "'magic' is unknown"),
    ("watch good.csv --stop-at-end --model rigid --terms joint_damping", "rigid joint; it has"),
    ("watch good.csv --stop-at-end --model link --terms motor_drag", "no term of the link joint"),
    ("watch good.csv --hold cubic", "must be auto, linear or zero, got 'cubic'"),
    ("watch good.csv --sample-time 0", "0 s is outside 1e-06 to 0.5 s"),
    ("watch good.csv --filter-rate 1e6", "give 0.04 to 125 1/s"),
    ("watch good.csv --memory 0.01", "give more than"),
    ("watch good.csv --every 0", "must be above 0 s, got 0.0"),
)


@pytest.mark.parametrize(("arguments", "said"), REFUSED, ids=[each for each, _ in REFUSED])
def test_a_refusal_is_one_sentence(flexid, folder, monkeypatch, arguments, said):
    """Assert that what is wrong is named in one line, and that no file is left."""
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
    """Assert that a usage error names what the command line lacks."""
    monkeypatch.chdir(folder)
    outcome = flexid(*shlex.split(arguments))
    assert (outcome.status, outcome.stdout) == (2, "")
    assert said in outcome.stderr
