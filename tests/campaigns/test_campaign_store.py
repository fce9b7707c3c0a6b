"""A campaign's directory: parts kept, repeated and refused, interruptions, and summaries."""

import errno
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import polars as pl
import pytest
from filelock import FileLock
from tests.campaigns.tiny import EXPERIMENT, made_manifest, rows_of, same_bits, write_experiment

from flexid.errors import CampaignError, SettingError
from flexid.experiments.campaign_runner import run_campaign
from flexid.experiments.campaign_store import find_store, open_store, summarise
from flexid.experiments.experiment import read_experiment
from flexid.experiments.variation import Distribution, Plan, Variation, make_plan

INPUTS = {"controller.k": Distribution(values=[float(k) for k in range(10, 17)])}
PLAN = make_plan(Variation(kind="grid", runs=7, vary=INPUTS), sampled=False)
MANIFEST = made_manifest(PLAN, "grid", 3)


def rows(runs):
    """Return rows of some runs, as after a run."""
    return PLAN.table(runs).with_columns(tracking_rms=pl.col("controller.k") / 3.0)


@pytest.fixture
def full(tmp_path):
    """Return a directory with all parts."""
    with open_store(tmp_path / "out", MANIFEST) as store:
        for part in MANIFEST.parts:
            store.write(part, rows(MANIFEST.runs_of(part)))
        assert store.missing() == []
    return tmp_path / "out"


def missing(directory, manifest=MANIFEST):
    """Return the numbers of the parts to run."""
    with open_store(directory, manifest) as store:
        return store.missing()


@pytest.mark.parametrize(
    "damage",
    [
        *(lambda path, n=n: path.write_bytes(path.read_bytes()[:n]) for n in (0, 3, 200, -1)),
        lambda path: path.rename(path.with_name(f".{path.name}.tmp")),  # as left by kill -9
        lambda path: path.write_bytes(path.with_name("part-000000.parquet").read_bytes()),
        lambda path: pl.DataFrame({"a": [1]}).write_parquet(path),
    ],
)
def test_a_damaged_part_is_run_again(full, damage):
    """Assert that only a part that is truncated or from another campaign counts as missing."""
    damage(full / "runs" / "part-000001.parquet")
    assert missing(full) == [1]


def test_parts_of_a_directory(tmp_path, full):
    """Assert a manifest before parts, each run once, and the size of parts that exist."""
    assert missing(tmp_path / "a" / "b") == [0, 1, 2]
    assert json.loads((tmp_path / "a" / "b" / "campaign.json").read_text())["runs"] == 7
    assert [list(MANIFEST.runs_of(n)) for n in MANIFEST.parts] == [[0, 1, 2], [3, 4, 5], [6]]
    with open_store(full, MANIFEST.model_copy(update={"runs_per_part": 2})) as store:
        assert store.manifest == MANIFEST
        assert store.missing() == []


def refusal(opened, directory):
    """Return the one sentence with which a directory is refused."""
    with pytest.raises((CampaignError, SettingError)) as refused:
        opened(directory)
    return str(refused.value)


CHANGES = {"flexid": "0.9", "experiment": "4567", "plan": "4567"}


def test_the_directory_of_something_else_is_refused(full, golden, monkeypatch):
    """Assert that a directory of another campaign is refused with the difference, unchanged."""
    monkeypatch.chdir(full.parent)
    before = sorted(path.stat().st_mtime_ns for path in full.rglob("*.parquet"))
    found = {}
    for field, value in CHANGES.items():
        other = MANIFEST.model_copy(update={field: value})
        found[field] = refusal(lambda path, other=other: missing(path, other), Path("out"))
    golden(found)
    assert sorted(path.stat().st_mtime_ns for path in full.rglob("*.parquet")) == before


WRITTEN = MANIFEST.model_dump(mode="json")
DAMAGED = (
    *("", "{", "[]", "{}", '{"flexid": 3}', "null", '{"runs": -1}', "\x00\xff"),
    *(
        json.dumps({**WRITTEN, field: [value] if isinstance(value, str | int) else "text"})
        for field, value in WRITTEN.items()
    ),
)


def test_directories_that_cannot_be_used(full, golden, monkeypatch):
    """Assert that unusable directories are refused in one sentence, on writing and reading."""
    monkeypatch.chdir(full.parent)
    Path("file").write_text("")
    Path("empty").mkdir()
    nameless = Path(os.fsdecode(b"\xff"))
    found = {}
    for name in ("file", "file/below", nameless):
        found[f"{name!r} to write"] = refusal(missing, Path(name))
    for name in ("empty", "nothing", "file", nameless):
        found[f"{name!r} to read"] = refusal(find_store, Path(name))
    assert not nameless.exists()
    with FileLock(full / ".campaign.lock"):
        found["in use"] = refusal(missing, Path("out"))
        assert find_store(full).read(0) is not None
    assert missing(full) == []
    with open_store(Path("out"), MANIFEST) as opened, monkeypatch.context() as patched:
        opened.path(1).unlink()
        full_disk = OSError(errno.ENOSPC, "No space left on device")
        patched.setattr(os, "fsync", Mock(side_effect=full_disk))
        found["a full disk"] = refusal(lambda _: opened.write(1, rows(range(3, 6))), None)
    assert missing(full) == [1]
    (full / "campaign.json").unlink()
    found["no manifest"] = refusal(missing, Path("out"))
    for text in DAMAGED:
        (full / "campaign.json").write_text(text)
        (found["a damaged manifest"],) = {
            refusal(one, Path("out")) for one in (missing, find_store)
        }
    golden(found)


KILLED = """
import os, signal, sys
from flexid import files
from flexid.experiments.campaign_runner import run_campaign
from flexid.experiments.experiment import read_experiment

replace, count = os.replace, 0

def killing(*names):
    global count
    count += str(names[1]).endswith(".parquet")
    if count == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    replace(*names)

files.os.replace = killing
run_campaign(read_experiment(sys.argv[1]), sys.argv[2])
"""


@pytest.fixture(scope="module")
def experiment(tmp_path_factory):
    """Return the tiny campaign."""
    return read_experiment(write_experiment(tmp_path_factory.mktemp("file") / "tiny.toml"))


@pytest.fixture(scope="module")
def whole(experiment, tmp_path_factory):
    """Return the rows of the campaign run at once, on one thread."""
    out = tmp_path_factory.mktemp("whole") / "out"
    run_campaign(experiment, out, workers=1)
    rows = rows_of(out)
    assert rows["status"].to_list() == ["finished"] * 12
    return rows


def test_processes_that_are_new_or_killed(experiment, whole, tmp_path):
    """Assert equal rows of four threads without kernels, and of a run after kill -9."""
    code = "from flexid.cli.main import main; main()"
    command = [sys.executable, "-c", code, "campaign", experiment.path, "--out", str(tmp_path)]
    subprocess.run([*command, "--workers", "4"], check=True, timeout=300)
    assert same_bits(rows_of(tmp_path), whole)
    out = tmp_path / "out"
    killed = subprocess.run([sys.executable, "-c", KILLED, experiment.path, str(out)], timeout=300)
    assert killed.returncode == -signal.SIGKILL
    assert len(list(out.glob("runs/part-*.parquet"))) == 2
    kept = []
    run_campaign(experiment, out, progress=lambda done, _: kept.append(done))
    assert kept == [6, 9, 12]
    assert same_bits(rows_of(out), whole)


def test_control_c_keeps_what_is_done(tmp_path):
    """Assert that an interrupt exits with 3 and one sentence, and that whole parts are kept."""
    text = EXPERIMENT.replace("duration = 0.1", "duration = 60.0")
    campaign = "[campaign]\nkind = 'latin-hypercube'\nruns = 2000\nruns_per_part = 2\n"
    campaign += "vary.observer.link = { uniform = [1.0, 2.0] }\n"
    path, out = write_experiment(tmp_path / "slow.toml", campaign, text), tmp_path / "out"
    command = [sys.executable, "-c", "from flexid.cli.main import main; main()"]
    process = subprocess.Popen(
        [*command, "campaign", str(path), "--out", str(out)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    while process.poll() is None and not list(out.glob("runs/part-*")):
        time.sleep(0.02)
    os.kill(process.pid, signal.SIGINT)
    stdout, stderr = process.communicate(timeout=120)
    done = 2 * len(list(out.glob("runs/part-*")))
    assert (process.returncode, stdout) == (3, "")
    assert stderr.splitlines() == ["flexid: interrupted: give the same command again to continue"]
    assert 0 < done < 2000


UNIFORM = {
    "controller.k": Distribution(uniform=[10.0, 50.0]),
    "plant.link_inertia": Distribution(uniform=[0.8, 1.2]),
}


def made_up_rows(plan: Plan, runs: range) -> pl.DataFrame:
    """Return rows with results computed from the inputs; every tenth run diverges."""
    table = plan.table(runs)
    k, inertia = table["controller.k"].to_numpy(), table["plant.link_inertia"].to_numpy()
    diverged = table["run"].to_numpy() % 10 == 7
    results = {
        "final_error.theta1": np.where(diverged, 1e9, (inertia - 1.0) * 100.0),
        "settling_time.theta1": np.where(k > 30.0, np.nan, k),
        "tracking_rms": 1.0 / k,
    }
    return table.with_columns(
        status=pl.Series(["diverged" if one else "finished" for one in diverged]),
        error=pl.lit(None, pl.String),
        reached=pl.lit(1.0),
        steps=pl.lit(10, pl.Int64),
        **{name: pl.Series(values) for name, values in results.items()},
    )


def write_campaign(out, parts=None):
    """Write a campaign of synthetic rows, or some of its parts."""
    plan = make_plan(Variation(kind="sobol", runs=400, vary=UNIFORM), sampled=False)
    manifest = made_manifest(plan, "sobol", 50)
    with open_store(out, manifest) as store:
        for part in manifest.parts if parts is None else parts:
            store.write(part, made_up_rows(plan, manifest.runs_of(part)))
    return out


def test_campaigns_are_summarised(tmp_path):
    """Assert counts and quantiles of finished runs, and truncated parts of unfinished ones."""
    finished = summarise(write_campaign(tmp_path))
    assert list(finished.statuses.items()) == [("finished", 360), ("diverged", 40)]
    assert (finished.complete, finished.done, finished.finished) == (True, 400, 360)
    names = ("final_error", "settling_time")
    error, settling = (finished.results[f"{name}.theta1"] for name in names)
    assert [*error.quantiles.values()] == pytest.approx((-18.0, 0.0, 18.0), abs=3.0)
    assert [*settling.quantiles.values()] == pytest.approx((11.0, 20.0, 29.0), abs=0.5)
    assert settling.missing == pytest.approx(180, abs=10)
    some = write_campaign(tmp_path / "some", parts=[0, 3, 4])
    path = some / "runs" / "part-000004.parquet"
    path.write_bytes(path.read_bytes()[:100])
    found = summarise(some)
    assert found.damaged == ("part-000004.parquet",)
    assert (found.complete, found.done, found.manifest.runs) == (False, 100, 400)
    assert sum(found.statuses.values()) == 100
    with pytest.raises(CampaignError, match="has no rows yet"):
        summarise(write_campaign(tmp_path / "none", parts=[]))
