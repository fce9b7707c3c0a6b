"""`flexid compare`: output, files, exit status and refusals."""

import json
from pathlib import Path

import numpy as np
import pytest

import flexid as library
from flexid.arrays import to_json
from flexid.stored_estimates.estimate_file import estimate_document
from made_estimates import STIFFER, TRUE, drawn, exact, with_parameter


def stored(folder: Path, estimate) -> Path:
    """Return a folder as written by `flexid identify --out`."""
    folder.mkdir()
    (folder / "estimate.json").write_text(to_json(estimate_document(estimate)))
    return folder


@pytest.fixture
def folders(tmp_path):
    """Return folders of one drive twice, and of a stiffer one."""
    trues = {"before": TRUE, "again": TRUE, "after": STIFFER}
    return {name: stored(tmp_path / name, exact(true, name)) for name, true in trues.items()}


def test_a_change_is_status_1(flexid, folders):
    """Assert that one drive twice exits with 0, and that a changed stiffness is named."""
    outcome = flexid("compare", folders["before"], folders["again"])
    assert (outcome.status, outcome.stderr) == (0, "")
    assert "No change was found in 5 numbers" in outcome.stdout
    files = [folders[name] / "estimate.json" for name in ("before", "after")]
    outcome = flexid("compare", *files)
    assert outcome.status == 1
    assert "Changed: joint_stiffness by 1" in outcome.stdout


def test_documents_agree(flexid, folders, tmp_path):
    """Assert that the printed, written and returned JSON documents are equal."""
    pair = folders["before"], folders["after"]
    printed = json.loads(flexid("compare", *pair, "--json").stdout)
    flexid("compare", *pair, "--out", tmp_path / "out")
    written = json.loads((tmp_path / "out" / "comparison.json").read_text())
    assert written == printed
    page = (tmp_path / "out" / "report.html").read_text()
    assert page.startswith("<!DOCTYPE html>")
    assert "flexid compare" in page
    found = library.compare(*pair)
    assert found.document == printed
    stiffness = printed["parameters"]["joint_stiffness"]
    assert stiffness["outcome"] == "changed"
    assert stiffness["interval"][0] < 10.0 < stiffness["interval"][1]
    assert printed["a"] == str(pair[0] / "estimate.json")


def test_the_library_takes_whatever_holds_an_estimate(folders):
    """Assert that estimates, folders, files and documents give the same comparison."""
    file = folders["before"] / "estimate.json"
    other = library.load(folders["after"])
    forms = (library.load(file), folders["before"], str(file), json.loads(file.read_text()))
    answers = [library.compare(form, other) for form in forms]
    assert len({str(answer.document["parameters"]) for answer in answers}) == 1
    answer = answers[0]
    assert answer.changed == ("joint_stiffness",)
    assert not answer.agree
    assert repr(answer) == "<EstimateComparison: 5 compared, changed: joint_stiffness>"
    assert "Changed: joint_stiffness" in answer.summary()
    assert "&lt;" not in answer._repr_html_()


def test_what_is_not_determined_is_status_1(flexid, folders, tmp_path):
    """Assert that a value undetermined in one log prevents agreement."""
    rng = np.random.default_rng(3)
    infinite = {"std": np.inf, "interval": (-np.inf, np.inf), "verdict": "undetermined"}
    vague = with_parameter(drawn(rng), "joint_stiffness", reason="nothing on it", **infinite)
    outcome = flexid("compare", folders["before"], stored(tmp_path / "vague", vague))
    assert outcome.status == 1
    said = " ".join(outcome.stdout.split())
    assert "joint_stiffness: in B nothing on it" in said
    assert "Not determined in A or in B, and so not compared: joint_stiffness." in said
