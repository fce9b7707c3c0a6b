"""``flexid derive`` from the command line: text, notes, exit status."""

import json
from pathlib import Path


def test_notes_are_on_stderr(flexid, examples: Path):
    """Assert that a required u' and numerical integrals are noted on stderr, with JSON too."""
    done = flexid("derive", "flexible-joint", "--unknown-input-gain", "--to", "c")
    assert done.status == 0
    assert "u_rate" in done.stderr
    assert "note" not in done.stdout
    model = examples / "models" / "stribeck.toml"
    done = flexid("derive", model)
    assert done.status == 0
    assert "stribeck; integrated numerically" in done.stderr
    done = flexid("derive", model, "--to", "c", "--json")
    document = json.loads(done.stdout)
    assert document["to"] == "c"
    assert "rate[" in document["text"]
    assert "integrated numerically" in document["notes"][0]


def test_exported_files_are_listed(flexid, tmp_path: Path):
    """Assert that --json lists the written files."""
    options = ("--to", "c99", "--sample-time", "0.001", "--out", str(tmp_path), "--json")
    done = flexid("export", "flexible-joint", *options)
    assert done.status == 0, done.stderr
    document = json.loads(done.stdout)
    assert {Path(path).name for path in document["files"]} == {p.name for p in tmp_path.iterdir()}
    assert document["files"]
