"""Results of functions: the commands', as text, frames and files; a watch, fed or following."""

import json
from functools import partial
from pathlib import Path

import pytest
from matplotlib.figure import Figure

import flexid as library
from flexid.errors import RecordingError
from flexid.streaming import incoming

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


def test_a_derivation_and_a_reproduction(reproduction, flexid):
    """Assert the command's text of a name, file or model, and the study's claims in all forms."""
    from flexid.library.simulate import PaperReproduction

    found = PaperReproduction(reproduction)
    assert found.claims == reproduction.claims
    assert f"of {len(found.claims)} claims" in repr(found)
    assert found.summary()
    assert found.document
    model = ROOT / "examples" / "models" / "pendulum.toml"
    assert library.derive(model, to="c") == flexid("derive", model, "--to", "c").stdout
    assert library.derive(library.read_model(model)) == library.derive(model)
    shipped = flexid("derive", "flexible-joint", "--terms", "gravity", "--to", "python").stdout
    assert library.derive("flexible-joint", terms=["gravity"], to="python") == shipped


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


LOG = Path("examples/flexible_joint.csv")
PAPER = {"terms": ("gravity", "motor_viscous"), "hold": "linear"}


@pytest.fixture(scope="module")
def samples():
    """Return the samples of the example."""
    return library.samples(LOG)[0]


def channels(samples, part=slice(None)):
    """Return the channels as keywords."""
    return {
        "link_position": samples.positions[part, 0],
        "motor_position": samples.positions[part, 1],
        "motor_torque": samples.inputs[part, 0],
    }


def test_fed_one_by_one(samples):
    """Assert that samples may be plain numbers, and that reading results changes nothing."""
    one, block = library.watch(sample_time=1e-3, **PAPER), library.watch(sample_time=1e-3, **PAPER)
    assert one.health.health is library.Health.CONVERGING
    assert "no sample" in one.health.reason
    for k in range(1500):
        one.feed(**{name: float(values[k]) for name, values in channels(samples).items()})
        if k % 400 == 0:
            assert one.counts.fed == k + 1
    block.feed(**channels(samples, slice(1500)))
    assert one.document == block.document
    assert one.parameters["joint_stiffness"].value == pytest.approx(100.0, rel=0.01)
    assert set(one.excitation) == {"link", "motor"}
    assert "joint_stiffness" in one.summary()
    assert repr(one).startswith("<Watch: conver")


def test_a_source_that_cannot_be_read_on(tmp_path, monkeypatch):
    """Assert that all samples before a read error are processed."""
    text = "".join(LOG.read_text().splitlines(keepends=True)[:3001])

    def fails(*_, **__):
        yield text.encode()
        raise OSError(5, "Input/output error")

    monkeypatch.setattr(incoming, "open_source", fails)
    log = tmp_path / "log.csv"
    watch = iter(library.watch(log, every=10.0, **PAPER))
    assert next(watch).counts.taken == 3000
    with pytest.raises(RecordingError, match=r"cannot be read on \(Input/output error\)"):
        next(watch)


def test_what_is_not_fed_or_followed(samples, refusals):
    """Assert that a followed source cannot be fed, and that bad samples or sources are refused."""
    watch, unfed = (library.watch(sample_time=1e-3, **PAPER) for _ in range(2))
    watch.feed(**channels(samples, slice(10)))
    calls = {
        "other channels": lambda: watch.feed(motor_position=0.0, motor_torque=0.0),
        "a source": lambda: library.watch(LOG).feed(motor_position=0.0, motor_torque=0.0),
        "no source": lambda: next(iter(unfed)),
    }
    for name, position in {"two of one": [1.0, 2.0], "text": "x", "a matrix": [[1.0]]}.items():
        calls[name] = partial(unfed.feed, motor_position=position, motor_torque=[1.0])
    refusals(calls)
