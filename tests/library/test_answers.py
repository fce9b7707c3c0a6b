"""Results of the other functions: equal to the commands', as text, frames, figures and files."""

import json
from pathlib import Path

import pytest
from matplotlib.figure import Figure

import flexid as library

ROOT = Path(__file__).parents[2]
CAMPAIGN = """
[campaign]
kind = "grid"

[campaign.vary]
controller.proportional = [40.0, 50.0]
"""


@pytest.fixture(scope="module")
def experiment(tmp_path_factory):
    """Return a tenth of a second of a closed loop, and a campaign of two such runs."""
    path = tmp_path_factory.mktemp("experiment") / "tiny.toml"
    text = (ROOT / "experiments" / "sampled_joint.toml").read_text()
    assert "duration = 30.0" in text
    path.write_text(text.replace("duration = 30.0", "duration = 0.1") + CAMPAIGN)
    return path


def test_a_run(experiment, flexid, tmp_path):
    """Assert that a run equals the command's, with the values set, and serves as a log."""
    run = library.simulate(experiment, set={"controller.proportional": 45})
    printed = flexid("simulate", experiment, "--set", "controller.proportional=45", "--json")
    run.save(tmp_path / "run.json")
    assert json.loads((tmp_path / "run.json").read_text()) == json.loads(printed.stdout)
    frame = run.to_dataframe()
    assert len(frame) == len(run.result.time)
    (recording,) = run.log().recordings
    assert recording.input_unit == "N m"
    titles = [run.plot(name).get_suptitle() for name in ("motion", "estimates")]
    assert titles == [f"{run.experiment.name}: motion", f"{run.experiment.name}: estimates"]
    assert "<img" in run._repr_html_()
    assert "0.1 s" in repr(run)


def test_a_campaign(experiment, tmp_path):
    """Assert that every run is counted, also if the campaign is summarised later."""
    reached = []
    found = library.campaign(
        experiment, out=tmp_path / "rows", workers=1, progress=lambda *n: reached.append(n)
    )
    assert reached[-1] == (2, 2)
    assert found.complete
    assert found.statuses == {"finished": 2}
    again = library.campaign(summary=tmp_path / "rows")
    assert again.document == found.document
    assert again.summary() == found.summary()
    found.save_figures(tmp_path / "figures")
    assert "2 of 2 runs" in repr(found)


def test_a_derivation(flexid):
    """Assert that the text equals the command's, from a name, a file, or a model."""
    model = ROOT / "examples" / "models" / "pendulum.toml"
    assert library.derive(model, to="c") == flexid("derive", model, "--to", "c").stdout
    assert library.derive(library.read_model(model)) == library.derive(model)
    shipped = flexid("derive", "flexible-joint", "--terms", "gravity", "--to", "python").stdout
    assert library.derive("flexible-joint", terms=["gravity"], to="python") == shipped


def test_a_design(tiny_drive, flexid, tmp_path, monkeypatch):
    """Assert that the design equals the command's, as a document, a figure and a page."""
    monkeypatch.setattr("flexid.experiment_design.design.STARTS", 1)
    steps = []
    design = library.design(tiny_drive, progress=steps.append)
    printed = flexid("design", tiny_drive, "--json")
    design.save(tmp_path / "design.json")
    assert json.loads((tmp_path / "design.json").read_text()) == json.loads(printed.stdout)
    assert steps
    assert isinstance(design.plot(), Figure)
    assert design._page().title == "The designed torque"
    assert max(design.deviations.values()) == design.result.prediction.worst
    assert repr(design).startswith("<ExperimentDesign: 2 s, worst coefficient")


def test_a_reproduction(reproduction):
    """Assert that the claims equal the study's, as text and as a document."""
    from flexid.library.simulate import PaperReproduction

    found = PaperReproduction(reproduction)
    assert found.claims == reproduction.claims
    assert f"of {len(found.claims)} claims" in repr(found)
    assert found.summary()
    assert found.document


def test_an_excitation(examples, example_estimate):
    """Assert that the report has the estimate of `identify`, and each coefficient's partner."""
    options = {"terms": ["gravity", "motor_viscous"], "hold": "zero", "segment_duration": 2.0}
    found = library.excitation(examples / "flexible_joint.csv", **options)
    estimate = example_estimate
    assert found.estimate.coefficients == estimate.coefficients
    assert {name: c.verdict for name, c in found.coefficients.items()} == {
        name: c.verdict for name, c in estimate.coefficients.items()
    }
    assert found.supports(strict=True)
    assert found.advice is None
    assert "5 of 5 coefficients determined" in repr(found)
    assert "theta2" in found.summary()
