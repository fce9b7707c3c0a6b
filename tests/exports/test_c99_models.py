"""Models that are awkward in C: names that C or the estimator has already, rows of any length."""

import pytest
from drive import compiled, run

import flexid
from flexid.errors import SettingError
from flexid.exports.c99 import DriveSource
from flexid.exports.request import EstimatorSettings, ExportRequest

SETTINGS = EstimatorSettings(1e-3)


def arm(regressors, name="arm", **options):
    """A model of one row."""
    row = flexid.Row(name, "q", "v", regressors, "u")
    return flexid.ParametricSystem("model", (row,), **options)


def test_names_that_are_taken_are_renamed(tmp_path):
    """Assert that coefficients and constants of such names compile, and the estimates agree."""
    taken = {"FLEXID_ROWS": "sin(q)", "POLE": "q", "uint32_t": "cos(q)"}
    regressors = {name: f"-{name}_2*{shape}" for name, shape in taken.items()}
    constants = {f"{name}_2": 2.0 for name in taken}
    model = arm({**regressors, "viscous": "-v"}, constants=constants)
    flexid.export(model, to="c99", sample_time=1e-3, out=tmp_path / "drive")
    printed = run(compiled("gcc", tmp_path / "drive", out=tmp_path / "run"))
    assert all(f"{name.lower()}_ = " in printed for name in taken)


def test_a_row_that_is_too_long():
    """Assert that a row of more coefficients than there are bits is refused."""
    rows = [{f"c{i}": f"sin({i + 1}*q)" for i in range(count)} for count in (31, 32)]
    assert (
        "row[0].unknown[30]" in DriveSource(ExportRequest(arm(rows[0]), settings=SETTINGS)).source()
    )
    with pytest.raises(SettingError, match="arm: has 32 coefficients"):
        DriveSource(ExportRequest(arm(rows[1]), settings=SETTINGS))


def test_no_text_of_a_model_ends_a_comment():
    """Assert that names in comments are on one line and do not end them, in FMUs either."""
    from flexid.exports.fmu import estimator_model

    model = arm({"gravity": "-sin(q)"}, "arm *\\\n/ int evil; /*")
    unit = estimator_model(ExportRequest(model, settings=SETTINGS))
    for text in (unit.header(), *unit.sources.values()):
        assert "\\\n/" not in text
        assert "\n/ int" not in text
