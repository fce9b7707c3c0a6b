"""The result of `identify`: values, frames, figures, files, and predictions of other logs."""

import json
import re
from dataclasses import replace
from functools import partial

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import polars as pl
import pytest
from matplotlib.figure import Figure

import flexid
from flexid.errors import SettingError


@pytest.fixture(scope="module")
def estimate(example_estimate):
    """Return the estimate of the example."""
    return example_estimate


@pytest.fixture(scope="module")
def loaded(estimate, tmp_path_factory):
    """Return the estimate, read from its file."""
    path = tmp_path_factory.mktemp("estimate") / "estimate.json"
    estimate.save(path)
    return flexid.load(path)


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
    poor = flexid.JointEstimate(replace(estimate.result, fit=lost, parameters=parameters))
    variance = dict(zip(poor.names, np.diag(poor.covariance), strict=True))
    free = {name for name, v in variance.items() if np.isinf(v)}
    assert free == {"theta1", "gravity_torque", "bend"}


def test_it_shows_itself(estimate, loaded):
    """Assert that line, text and page show the parameters, and that warnings are escaped."""
    assert re.fullmatch(
        r"<JointEstimate: flexible joint, parameters: 5 determined.*>", repr(estimate)
    )
    assert "joint_stiffness" in estimate.summary()
    assert len(estimate.summary(explain=True)) > len(estimate.summary())
    page = estimate._repr_html_()
    assert "joint_stiffness" in page
    assert "determined" in page
    assert page.count("<img") == 1

    spiked = replace(estimate.result, warnings=("<script>alert(1)</script>",))
    assert "<script>" not in flexid.JointEstimate(spiked)._repr_html_()


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
    assert flexid.validate(loaded, log).fit_percent == found.fit_percent == arrays.fit_percent
    assert min(found.fit_percent.values()) > 99
    difference = found.series["motor_position"] - found.series["predicted_motor_position"]
    assert np.sqrt(np.mean(difference**2)) < 2e-4
    assert found.series["time"][0] == pytest.approx(0.5)
    assert [*found.series][:3] == ["time", "link_position", "predicted_link_position"]
    assert found.horizons[1.0]["deflection"] > 99
    assert found.plot().axes
    assert found.plot("residuals").axes
    assert "<img" in found._repr_html_()
    found.save(tmp_path / "validation.json")
    assert json.loads((tmp_path / "validation.json").read_text())["model"] == "flexible"
