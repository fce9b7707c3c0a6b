"""Results of functions, as of `identify`: values, text, frames, figures, files; a watch."""

import json
import os
import re
from dataclasses import replace
from functools import partial
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import polars as pl
import pytest
from matplotlib.figure import Figure

import flexid as library
from flexid.errors import RecordingError, SettingError
from flexid.streaming import incoming

ROOT = Path(__file__).parents[2]


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


@pytest.fixture(scope="module")
def estimate(example_estimate):
    """Return the estimate of the example."""
    return example_estimate


@pytest.fixture(scope="module")
def loaded(estimate, tmp_path_factory):
    """Return the estimate, read from its file."""
    path = tmp_path_factory.mktemp("estimate") / "estimate.json"
    estimate.save(path)
    return library.load(path)


@pytest.mark.skipif(os.name != "posix", reason="pipes and links by path")
def test_saving_replaces_no_device_and_no_link(estimate, tmp_path):
    """Assert that what is no regular file stays, and that a link's target is written."""
    pipe, link, target = (tmp_path / name for name in ("pipe", "link.json", "target.json"))
    os.mkfifo(pipe)
    link.symlink_to(target)
    with pytest.raises(SettingError, match="not a regular file"):
        estimate.save(pipe)
    assert pipe.is_fifo()
    estimate.save(link)
    assert link.is_symlink()
    assert library.load(target).summary() == estimate.summary()


def test_covariance_of_all_values(estimate):
    """Assert standard errors, ratios, and infinite variances of all that the log leaves free."""
    shown = {**estimate.parameters, **estimate.coefficients}
    deviations = np.sqrt(np.diag(estimate.covariance))
    np.testing.assert_allclose(deviations, [e.std for e in shown.values()], rtol=1e-9)
    # The link's inertia is stiffness over theta2.
    names = list(estimate.names)
    stiffness, theta = estimate.parameters["joint_stiffness"], estimate.coefficients["theta2"]
    places = [names.index("joint_stiffness"), names.index("theta2")]
    slopes = np.array([1 / theta.value, -stiffness.value / theta.value**2])
    variance = slopes @ estimate.covariance[np.ix_(places, places)] @ slopes
    assert np.sqrt(variance) == pytest.approx(estimate.parameters["link_inertia"].std, rel=1e-6)
    lost = estimate.result.fit.without_knowledge_of({"theta1"})
    held = replace(estimate.parameters["joint_stiffness"], name="bend", std=np.inf, slopes={})
    parameters = {**estimate.parameters, "bend": held}
    poor = library.JointEstimate(replace(estimate.result, fit=lost, parameters=parameters))
    variance = dict(zip(poor.names, np.diag(poor.covariance), strict=True))
    free = {name for name, v in variance.items() if np.isinf(v)}
    assert free == {"theta1", "gravity_torque", "bend"}


def test_it_shows_itself(estimate, loaded):
    """Assert that line, text and page show the parameters, and that warnings are escaped."""
    assert re.fullmatch(
        r"<JointEstimate: flexible joint, parameters: 5 determined.*>", repr(estimate)
    )
    assert len(estimate.summary(explain=True)) > len(estimate.summary())
    page = estimate._repr_html_()
    assert "joint_stiffness" in page
    assert "determined" in page
    assert page.count("<img") == 1

    spiked = replace(estimate.result, warnings=("<script>alert(1)</script>",))
    assert "<script>" not in library.JointEstimate(spiked)._repr_html_()


FIGURES = ("fit", "residuals", "bode")


@pytest.mark.parametrize("name", FIGURES)
def test_figures_leave_matplotlib_as_it_is(estimate, name):
    """Assert that a figure needs no display, changes no settings, and can replace given axes."""
    before = dict(mpl.rcParams)
    figure = estimate.plot(name)
    assert isinstance(figure, Figure)
    assert figure.axes
    assert figure._repr_png_().startswith(b"\x89PNG")  # type: ignore[attr-defined] - in a notebook
    assert dict(mpl.rcParams) == before
    assert plt.get_fignums() == []  # pyplot, which would need a display, has no figure
    own = Figure()
    left, right = own.subplots(1, 2)
    middle = 0.5 * (left.get_position().x1 + right.get_position().x0)
    assert estimate.plot(name, ax=right) is own
    assert own.axes[0] is left
    assert all(axes.get_position().x0 > middle for axes in own.axes[1:])
    assert right not in own.axes
    with pytest.raises(SettingError, match=r"ax.*plt\.subplots"):
        estimate.plot(name, ax=Figure().add_axes((0, 0, 1, 1)))


def test_what_a_figure_does_not_take_is_named(estimate, refusals):
    """Assert that an invalid option is refused in one sentence."""
    calls = {
        "an option": ("bode", {"colour": "red"}),
        "axes": ("fit", {"ax": 3}),
        "a name": (3, {}),
    }
    refusals({what: partial(estimate.plot, name, **more) for what, (name, more) in calls.items()})


def test_values_by_name(estimate):
    """Assert a row for each value with its interval, items by name, and a similar name."""
    rows = {row["name"]: row for row in estimate.to_dataframe(level=0.5).to_dicts()}
    assert tuple(rows) == estimate.names
    low, high = estimate.intervals(0.5)["joint_stiffness"]
    assert (rows["joint_stiffness"]["lower"], rows["joint_stiffness"]["upper"]) == (low, high)
    assert rows["joint_stiffness"]["kind"] == "parameter"
    assert estimate["joint_stiffness"] == estimate.parameters["joint_stiffness"]
    assert estimate["theta2"] == estimate.coefficients["theta2"]
    assert "theta2" in estimate
    assert [*estimate] == [*estimate.names]
    with pytest.raises(SettingError, match="did you mean joint_stiffness"):
        estimate["joint_stifness"]
    assert estimate.terms == ("gravity", "motor_viscous")
    assert estimate.settings["hold"] == "zero"


def test_results_cannot_be_changed(estimate, loaded):
    """Assert that an estimate is read-only."""
    for mapping in (estimate.parameters, estimate.coefficients, estimate.fit_percent):
        with pytest.raises(TypeError, match="assignment"):
            mapping["joint_stiffness"] = 3
    with pytest.raises(AttributeError, match="is read-only"):
        estimate.parameters = {}
    loaded.document["parameters"].clear()
    assert loaded.document == estimate.document


def test_residuals_and_criteria(estimate, loaded):
    """Assert residuals at the noise, their chi-square and criteria, and none from a file."""
    assert np.std(estimate.residuals["motor_position"]) < 2e-4
    (recording,) = estimate.result.recordings
    assert estimate.chi_square == pytest.approx(2 * len(recording), rel=0.1)
    assert estimate.aic == estimate.chi_square + 10.0
    assert estimate.bic == pytest.approx(estimate.chi_square + 5.0 * np.log(2 * len(recording)))
    assert loaded.summary(explain=True) == estimate.summary(explain=True)
    assert loaded.document == estimate.document
    assert loaded.residuals == {}
    assert np.isnan(loaded.bic)


def test_it_is_held_against_a_log(estimate, loaded, examples, tmp_path):
    """Assert that the log is predicted to its noise, by the estimate, a file or arrays."""
    log = examples / "flexible_joint.csv"
    found, frame = estimate.validate(log), pl.read_csv(log)
    arrays = loaded.validate({name: frame[name].to_numpy() for name in frame.columns})
    assert library.validate(loaded, log).fit_percent == found.fit_percent == arrays.fit_percent
    assert min(found.fit_percent.values()) > 99
    assert found.series["time"][0] == pytest.approx(0.5)
    assert [*found.series][:3] == ["time", "link_position", "predicted_link_position"]
    assert found.plot().axes
    assert found.plot("residuals").axes
    assert "<img" in found._repr_html_()
    found.save(tmp_path / "validation.json")
    assert json.loads((tmp_path / "validation.json").read_text())["model"] == "flexible"
