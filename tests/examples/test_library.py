"""The example of the library runs as a user runs it."""

import runpy
import sys

import pytest


@pytest.mark.thorough
def test_the_example_runs(examples, tmp_path, monkeypatch, capsys):
    """Assert that it finds the joint, predicts it, and leaves what it promises."""
    script = examples / "library.py"
    arguments = [str(script), str(examples / "flexible_joint.csv"), str(tmp_path)]
    monkeypatch.setattr(sys, "argv", arguments)
    runpy.run_path(str(script), run_name="__main__")
    printed = capsys.readouterr().out
    assert "joint_stiffness: 100.000" in printed
    assert "resonance with the motor locked: 10.000 rad/s" in printed
    assert "parameters: 5 determined" in printed
    assert {path.name for path in tmp_path.iterdir()} >= {"estimate.json", "fit.png"}


def test_a_bad_log_ends_it_with_a_sentence(examples, tmp_path):
    """Assert that one clause catches what may go wrong."""
    main = runpy.run_path(str(examples / "library.py"))["main"]
    with pytest.raises(SystemExit, match="no such file"):
        main(tmp_path / "missing.csv", tmp_path)
