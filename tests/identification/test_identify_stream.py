"""A log that streams by gives what it gives in memory."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from flexid.errors import RecordingError, SettingError
from flexid.identification import stream
from flexid.identification.identify import identify
from flexid.identification.result import Identification
from flexid.identification.settings import Settings
from flexid.identification.stream import identify_stream
from flexid.models.flexible_joint import flexible_joint
from flexid.recording.read import read_log
from flexid.simulation.free_run import free_run

TRUE = {"theta1": 5.0, "theta2": 100.0, "alpha1": 1000 / 3, "alpha2": 1 / 3, "beta1": 10 / 3}
ROWS = 60_000
CHOSEN = Settings(
    terms=("gravity", "motor_viscous"),
    hold="linear",
    input_delay=0.0,
    link_delay=0.0,
    filter_rate=20.0,
    estimator="least-squares",
)


@pytest.fixture(scope="module")
def columns() -> dict[str, np.ndarray]:
    """A minute of Table I's joint at 1 kHz, with noise."""
    time = 1e-3 * np.arange(ROWS)
    torque = np.sin(np.outer(time, [1.0, 4.3, 7.4, 11.3])) @ np.array([1.5, 3.0, 4.0, 5.0])
    states = free_run(flexible_joint(), TRUE, np.zeros(4), torque, 1e-3)
    noise = 1e-4 * np.random.default_rng(0).standard_normal((ROWS, 2))
    positions = states[:, ::2] + noise
    return {
        "time": time,
        "link_position": positions[:, 0],
        "motor_position": positions[:, 1],
        "motor_torque": torque,
    }


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """A head of twenty seconds and windows of eight."""
    monkeypatch.setattr(stream, "HEAD_ROWS", 20_000)
    monkeypatch.setattr(stream, "_WINDOW", 8_000)


@pytest.fixture
def log(tmp_path: Path, columns: dict[str, np.ndarray]) -> Callable[..., Path]:
    """A function that writes the log, without some of its rows."""

    def write(lost: tuple[int, ...] = (), **changed: np.ndarray) -> Path:
        path = tmp_path / "log.parquet"
        frame = pl.DataFrame({**columns, **changed})
        frame.filter(~pl.int_range(pl.len()).is_in(lost)).write_parquet(path)
        return path

    return write


def assert_same(found: Identification, expected: Identification) -> None:
    """Assert coefficients and intervals that agree to rounding."""
    assert set(found.coefficients) == set(expected.coefficients)
    for name, other in expected.coefficients.items():
        assert found.coefficients[name].value == pytest.approx(other.value, rel=1e-9)
        assert found.coefficients[name].interval == pytest.approx(other.interval, rel=1e-9)
        assert found.coefficients[name].std == pytest.approx(other.std, rel=1e-8)


@pytest.mark.usefixtures("small")
@pytest.mark.parametrize("lost", [(), (24_000, 24_001, 47_123)])
def test_a_stream_is_the_log_in_memory(log: Callable[..., Path], lost: tuple[int, ...]):
    """Assert that values and intervals are those in memory, with gaps and without."""
    path = log(lost)
    assert_same(identify_stream(path, settings=CHOSEN), identify([read_log(path)], CHOSEN))


@pytest.mark.usefixtures("small")
def test_delays_are_corrected_alike(log: Callable[..., Path]):
    """Assert that channels shifted by parts of a sample are shifted as in memory."""
    settings = Settings(
        terms=CHOSEN.terms,
        hold="linear",
        input_delay=1.3e-3,
        link_delay=-0.4e-3,
        filter_rate=20.0,
        estimator="least-squares",
    )
    path = log()
    assert_same(identify_stream(path, settings=settings), identify([read_log(path)], settings))


@pytest.mark.usefixtures("small")
def test_threads_change_nothing(log: Callable[..., Path]):
    """Assert that one thread and three give the same bits."""
    path = log()
    one, three = (identify_stream(path, settings=CHOSEN, workers=n) for n in (1, 3))
    np.testing.assert_array_equal(one.fit.values, three.fit.values)
    np.testing.assert_array_equal(one.fit.covariance, three.fit.covariance)


@pytest.mark.usefixtures("small")
def test_the_evidence_of_a_stream(log: Callable[..., Path]):
    """Assert that the choices are the head's, and that the whole is judged and described."""
    steps: list[tuple[int, int]] = []
    result = identify_stream(log(), advance=lambda done, rows: steps.append((done, rows)))
    assert set(result.choices.terms) == {"gravity", "motor_viscous"}
    assert all(c.status == "determined" for c in result.coefficients.values())
    for name, value in TRUE.items():
        assert result.coefficients[name].value == pytest.approx(value, rel=0.01)
    assert min(result.validation.fit_percent.values()) > 95.0
    assert len(result.validation.runs) > 3
    assert max(result.residual_excess.values()) < 1.2
    assert "60000 samples (1 min) were fitted in one pass" in result.summary[-1]
    assert len(result.provenance["inputs"][0]["sha256"]) == 64
    assert steps[-1] == (ROWS, ROWS)
    assert [done for done, _ in steps] == sorted(done for done, _ in steps)


@pytest.mark.usefixtures("small")
def test_a_bound_holds_in_a_stream(log: Callable[..., Path]):
    """Assert that a coefficient ends at its bound, as in memory."""
    settings = Settings(
        terms=CHOSEN.terms,
        hold="linear",
        input_delay=0.0,
        link_delay=0.0,
        filter_rate=20.0,
        estimator="least-squares",
        bounds={"alpha2": (0.5, np.inf)},
    )
    path = log()
    found, expected = identify_stream(path, settings=settings), identify([read_log(path)], settings)
    assert found.coefficients["alpha2"].reason == "at its bound"
    assert_same(found, expected)


@pytest.mark.usefixtures("small")
def test_a_change_of_the_joint_shows(log: Callable[..., Path], columns: dict[str, np.ndarray]):
    """Assert that a joint whose spring softens after the head is not called determined."""
    torque, time = columns["motor_torque"], columns["time"]
    soft = {**TRUE, "theta2": 60.0, "alpha1": 200.0}
    states = free_run(flexible_joint(), soft, np.zeros(4), torque[30_000:], 1e-3)
    late = time >= 30.0
    link, motor = columns["link_position"].copy(), columns["motor_position"].copy()
    link[late], motor[late] = states[:, 0], states[:, 2]
    path = log((30_000, 30_001), link_position=link, motor_position=motor)
    result = identify_stream(path, settings=CHOSEN)
    assert any(c.status != "determined" for c in result.coefficients.values())
    assert any("the free run repeats" in w or "leaves" in w for w in result.warnings)


@pytest.mark.usefixtures("small")
def test_friction_that_needs_velocities(log: Callable[..., Path]):
    """Assert that velocities derived window by window serve as those derived at once."""
    settings = Settings(
        terms=("gravity", "motor_viscous", "motor_coulomb"),
        hold="linear",
        input_delay=0.0,
        link_delay=0.0,
        filter_rate=20.0,
        coulomb_velocity=0.1,
        estimator="least-squares",
    )
    path = log()
    found, expected = identify_stream(path, settings=settings), identify([read_log(path)], settings)
    for name, other in expected.coefficients.items():
        # The window of the differentiator is chosen on the head alone.
        assert found.coefficients[name].value == pytest.approx(other.value, abs=0.3 * other.std)


def test_what_a_stream_refuses(log: Callable[..., Path]):
    """Assert that prediction error, a slow filter and a bad row are refused in a sentence."""
    path = log()
    with pytest.raises(SettingError, match="leave the estimator out"):
        identify_stream(path, settings=Settings(estimator="prediction-error"))
    with pytest.raises(SettingError, match="too slow for a stream"):
        identify_stream(path, settings=Settings(terms=("gravity",), hold="linear", filter_rate=0.1))
    bad = np.ones(ROWS)
    bad[50_000] = np.nan
    with pytest.raises(RecordingError, match="row 50001"):
        identify_stream(log(motor_torque=bad))
