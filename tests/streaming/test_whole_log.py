"""Identification of a log of any length in one pass."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

from flexid.errors import RecordingError
from flexid.estimators.channel_timing import later
from flexid.estimators.samples import samples_of_recording
from flexid.estimators.state_variable_filter import filtered_least_squares
from flexid.identification.identify import identify
from flexid.identification.preparation.recordings import IDEAL
from flexid.identification.preparation.settings import Settings
from flexid.identification.result import Identification
from flexid.models.flexible_joint import flexible_joint
from flexid.recording.read import read_log
from flexid.simulation.free_run import free_run
from flexid.streaming import incoming, whole_log
from flexid.streaming.whole_log import identify_stream
from made_estimates import TRUE

Columns = dict[str, np.ndarray]
Write = Callable[..., Path]
OTHERS = ("torn.parquet", "cut.parquet", "log.csv", "none.parquet")

ROWS = 40_000
TIME = 1e-3 * np.arange(ROWS)
CHOSEN = Settings(
    terms=("gravity", "motor_viscous"),
    hold="linear",
    input_delay=0.0,
    link_delay=0.0,
    filter_rate=20.0,
)


def moved(truth: dict[str, float], terms: tuple[str, ...] = (), seed: int = 0) -> Columns:
    """Return forty seconds of a joint at 1 kHz, with noise; friction is smoothed over 1 mrad/s."""
    torque = np.sin(np.outer(TIME, [1.0, 4.3, 7.4, 11.3])) @ np.array([1.5, 3.0, 4.0, 5.0])
    joint = flexible_joint(("gravity", "motor_viscous", *terms), coulomb_velocity=1e-3)
    positions = free_run(joint, truth, np.zeros(4), torque, 1e-3)[:, ::2]
    positions = positions + 1e-4 * np.random.default_rng(seed).standard_normal((ROWS, 2))
    names = ("time", "link_position", "motor_position", "motor_torque")
    return dict(zip(names, (TIME, *positions.T, torque), strict=True))


@pytest.fixture(scope="module")
def columns() -> Columns:
    """Return a log of Table I's joint."""
    return moved(TRUE)


@pytest.fixture(autouse=True)
def _small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Reduce the head to twelve seconds and blocks to five."""
    monkeypatch.setattr(whole_log, "HEAD_ROWS", 12_000)
    monkeypatch.setattr(incoming, "BLOCK", 5_000)


@pytest.fixture
def write(here: Path, columns: Columns) -> Write:
    """Return a function that writes the log, without some rows and with other columns."""

    def written(lost: tuple[int, ...] = (), **changed: np.ndarray | None) -> Path:
        path = Path("log.parquet")
        kept = {n: v for n, v in {**columns, **changed}.items() if v is not None}
        frame = pl.DataFrame(kept)
        rows = frame.filter(~pl.int_range(pl.len()).is_in(lost))
        rows.write_parquet(path, row_group_size=4_500)
        return path

    return written


def assert_holds(found: Identification, truth: dict[str, float], error: float = np.inf) -> None:
    """Assert that every interval contains the true value, within a maximum error."""
    for name, value in truth.items():
        lower, upper = found.coefficients[name].interval
        assert lower < value < upper, name
        assert found.coefficients[name].value == pytest.approx(value, rel=error), name


@pytest.mark.parametrize("lost", [(), (16_000, 16_001, 31_123)])
def test_a_stream_is_least_squares_in_memory(write: Write, lost: tuple[int, ...]):
    """Assert that values equal batch least squares, with and without gaps."""
    path = write(lost)
    found = identify_stream(path, settings=CHOSEN)
    samples = [samples_of_recording(recording) for recording in read_log(path).recordings]
    fit = filtered_least_squares(samples, flexible_joint(CHOSEN.terms), 20.0, "linear")
    for name, value in zip(fit.names, fit.values.tolist(), strict=True):
        assert found.coefficients[name].value == pytest.approx(value, rel=1e-6)
    assert_holds(found, TRUE, 0.01)
    assert any("3 missing; 2 gaps" in warning for warning in found.warnings) == bool(lost)


def test_the_evidence_of_a_stream(write: Write, monkeypatch: pytest.MonkeyPatch):
    """Assert choices from the head, verdicts from the whole log, and equal bits for any blocks."""
    path, steps = write(), list[str]()
    result = identify_stream(path, progress=steps.append)
    assert set(result.choices.terms) == {"gravity", "motor_viscous"}
    assert result.choices.estimator == "least-squares"
    assert result.verdict == "determined"
    assert_holds(result, TRUE, 0.01)
    assert min(result.validation.fit_percent.values()) > 95.0
    assert "motor_coulomb_friction" in result.removed
    assert not result.warnings
    assert "40000 samples (40 s) were fitted in one pass" in result.summary[-1]
    assert len(result.provenance["inputs"][0]["sha256"]) == 64
    assert steps[-1] == "100 % of 0.04 million samples"
    monkeypatch.setattr(incoming, "BLOCK", 17_000)
    again = identify_stream(path)
    np.testing.assert_array_equal(again.fit.values, result.fit.values)
    np.testing.assert_array_equal(again.fit.covariance, result.fit.covariance)


def test_a_dead_zone_is_corrected_in_the_whole_log(write: Write, columns: Columns):
    """Assert that a dead zone found in the head is corrected in every sample."""
    acting = columns["motor_torque"]
    commanded = acting + 0.4 * np.sign(acting)
    found = identify_stream(write(motor_voltage=commanded, motor_torque=None), settings=CHOSEN)
    assert found.choices.amplifier.dead_zone == pytest.approx(0.4, abs=0.02)
    assert found.coefficients["beta1"].value == pytest.approx(TRUE["beta1"], rel=0.005)
    assert any("dead zone" in warning for warning in found.warnings)


def test_a_filtered_encoder_is_refused(write: Write, monkeypatch: pytest.MonkeyPatch):
    """Assert that a head with a filtered encoder, which a stream cannot correct, is refused."""

    def head(*given: Any) -> Identification:
        found = identify(*given)
        choices = replace(found.choices, amplifier=replace(IDEAL, link_lag=0.01))
        return replace(found, choices=choices)

    monkeypatch.setattr(whole_log, "identify", head)
    with pytest.raises(RecordingError, match="seem to have been low-passed"):
        identify_stream(write(), settings=CHOSEN)


@pytest.mark.parametrize(("link_delay", "input_delay"), [(2.4e-3, 0.0), (-1.3e-3, 0.7e-3)])
def test_delays_are_covered(write: Write, columns: Columns, link_delay: float, input_delay: float):
    """Assert that intervals of delayed channels cover the truth, with a warning."""
    late = {
        "link_position": later(columns["link_position"], 1e3 * link_delay),
        "motor_torque": np.interp(TIME + input_delay, TIME, columns["motor_torque"]),
    }
    settings = replace(CHOSEN, link_delay=link_delay, input_delay=input_delay)
    found = identify_stream(write((*range(100), *range(ROWS - 100, ROWS)), **late), None, settings)
    assert_holds(found, TRUE)
    assert found.coefficients["theta2"].verdict == "determined"
    assert any("a channel is late" in warning for warning in found.warnings)


def test_what_is_known_and_bounded(write: Write):
    """Assert that a right known value is used, and that wrong statements cost every verdict."""
    path = write()
    right = identify_stream(path, settings=replace(CHOSEN, known={"motor_inertia": 0.3}))
    assert right.coefficients["beta1"].value == pytest.approx(10 / 3, rel=1e-12)
    assert_holds(right, {n: v for n, v in TRUE.items() if n != "beta1"}, 0.01)
    for stated in ({"known": {"motor_inertia": 0.4}}, {"bounds": {"alpha2": (0.5, np.inf)}}):
        wrong = identify_stream(path, settings=replace(CHOSEN, **stated))
        assert any("contradicts the log" in warning for warning in wrong.warnings)
        assert {c.verdict for c in wrong.coefficients.values()} == {"undetermined"}
    assert wrong.coefficients["alpha2"].value == 0.5


def test_a_change_of_the_joint_shows(write: Write, columns: Columns):
    """Assert that a softer spring is reported with its time, and identified from then on."""
    soft = {**TRUE, "theta2": 60.0, "alpha1": 200.0}
    other, late = moved(soft), TIME >= 20.0
    positions = ("link_position", "motor_position")
    changed = {name: np.where(late, other[name], columns[name]) for name in positions}
    result = identify_stream(write((20_000, 20_001), **changed), settings=CHOSEN)
    assert_holds(result, soft, 0.01)
    (change,) = (warning for warning in result.warnings if "the drive has changed" in warning)
    assert "since 21." in change
    assert "the values are those since then" in change


def test_dry_friction_is_covered(write: Write):
    """Assert that intervals cover the truth although dry friction is smoothed."""
    truth = {**TRUE, "alpha_coulomb": 1.5}
    result = identify_stream(write(**moved(truth, ("motor_coulomb",), 1)))
    assert "motor_coulomb" in result.choices.terms
    assert result.choices.coulomb_velocity is not None  # the smoothing velocity
    assert_holds(result, truth)


def test_a_stream_is_not_cut_at_a_seam(write: Write, columns: Columns):
    """Assert that the warning of joined logs says so, and that one of gaps is left alone."""
    jump = 0.4 * (TIME > 6.0)
    moved_on = {n: v + jump for n, v in columns.items() if "position" in n}
    found = identify_stream(write(tuple(range(3000, 3020)), **moved_on), settings=CHOSEN)
    assert any("joined, but a stream is not cut there: " in text for text in found.warnings)
    assert any("so the log was cut there into 3" in text for text in found.warnings)


def test_what_cannot_be_streamed(write: Write, refusals: Any):
    """Assert that each log is refused in one sentence, a row with its number."""
    jitter = TIME + 5e-5 * (np.arange(ROWS) == 20_000)
    slow = Settings(terms=("gravity",), hold="linear", filter_rate=0.01)
    raw = write().read_bytes()
    middle = 2 * len(raw) // 3
    Path("torn.parquet").write_bytes(raw[:middle] + bytes(40_000) + raw[middle + 40_000 :])
    Path("cut.parquet").write_bytes(raw[:-1000])
    Path("log.csv").write_text("time\n")
    refusals(
        {name: partial(identify_stream, Path(name), settings=CHOSEN) for name in OTHERS}
        | {"a model": lambda: identify_stream(write(), None, replace(CHOSEN, model="rigid"))}
        | {"a slow filter": lambda: identify_stream(write(), settings=slow)}
        | {"jitter": lambda: identify_stream(write(time=jitter), settings=CHOSEN)}
    )
