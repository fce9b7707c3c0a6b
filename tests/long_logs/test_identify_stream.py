"""A log that streams by gives what it gives in memory."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from flexid.errors import RecordingError, SettingError
from flexid.estimators.bounded import bounded_fit
from flexid.estimators.samples import samples_of_recording
from flexid.estimators.state_variable_filter import LeastSquaresFit, filtered_least_squares
from flexid.estimators.unknowns import Unknowns
from flexid.identification.preparation.alignment import Alignment, Delay, aligned
from flexid.identification.preparation.settings import Settings
from flexid.identification.result.identification import Identification
from flexid.long_logs import stream
from flexid.long_logs.stream import identify_stream
from flexid.models.flexible_joint import flexible_joint
from flexid.recording.read import read_log
from flexid.recording.velocities import with_velocities
from flexid.simulation.free_run import free_run

TRUE = {"theta1": 5.0, "theta2": 100.0, "alpha1": 1000 / 3, "alpha2": 1 / 3, "beta1": 10 / 3}
ROWS = 60_000
CHOSEN = Settings(
    terms=("gravity", "motor_viscous"),
    hold="linear",
    input_delay=0.0,
    link_delay=0.0,
    filter_rate=20.0,
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


def in_memory(path: Path, settings: Settings) -> dict[str, tuple[float, float]]:
    """Value and standard deviation of each coefficient by least squares of the whole log."""
    terms = () if settings.terms == "auto" else settings.terms
    late = [
        Delay(float(d), 0.0, (0.0, 0.0), "given")
        for d in (settings.input_delay, settings.link_delay)
    ]
    alignment = Alignment("linear", late[0], late[1], "")
    recordings = [with_velocities(aligned(p, alignment)) for p in read_log(path).recordings]
    width = 0.1 if settings.coulomb_velocity == "auto" else settings.coulomb_velocity
    system = flexible_joint(terms, coulomb_velocity=width)
    samples = [samples_of_recording(recording) for recording in recordings]

    def fit_with(unknowns: Unknowns) -> LeastSquaresFit:
        return filtered_least_squares(samples, system, 20.0, "linear", unknowns)

    fit, _ = bounded_fit(fit_with, Unknowns(system), settings.bounds)
    found = zip(fit.values.tolist(), fit.standard_deviations.tolist(), strict=True)
    return dict(zip(fit.names, found, strict=True))


def assert_least_squares(
    found: Identification, expected: dict[str, tuple[float, float]], share: float = 0.0
) -> None:
    """Assert values to rounding, or to a share of their deviation, and deviations not below."""
    for name, (value, std) in expected.items():
        c = found.coefficients[name]
        assert c.value == pytest.approx(value, rel=1e-9, abs=share * std)
        assert c.std >= (1.0 - 1e-8 - share) * std


@pytest.mark.usefixtures("small")
@pytest.mark.parametrize("lost", [(), (24_000, 24_001, 47_123)])
def test_a_stream_is_least_squares_in_memory(log: Callable[..., Path], lost: tuple[int, ...]):
    """Assert that values are those of least squares in memory, with gaps and without."""
    path = log(lost)
    found = identify_stream(path, settings=CHOSEN)
    assert_least_squares(found, in_memory(path, CHOSEN))
    assert found.choices.estimator == "least-squares"


@pytest.mark.usefixtures("small")
def test_delays_are_corrected_alike(log: Callable[..., Path]):
    """Assert that channels shifted by parts of a sample are shifted as in memory."""
    settings = replace(CHOSEN, input_delay=1.3e-3, link_delay=-0.4e-3)
    path = log()
    assert_least_squares(identify_stream(path, settings=settings), in_memory(path, settings))


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
    assert all(c.verdict == "determined" for c in result.coefficients.values())
    for name, value in TRUE.items():
        assert result.coefficients[name].value == pytest.approx(value, rel=0.01)
    assert min(result.validation.fit_percent.values()) > 95.0
    assert min(result.validation.horizons[1.0].values()) > 95.0
    assert len(result.validation.runs) > 3
    assert max(result.residual_excess.values()) < 1.2
    assert not set(result.removed) & set(result.parameters)
    assert "motor_coulomb_friction" in result.removed
    assert "60000 samples (1 min) were fitted in one pass" in result.summary[-1]
    assert len(result.provenance["inputs"][0]["sha256"]) == 64
    assert steps[-1] == (ROWS, ROWS)
    assert [done for done, _ in steps] == sorted(done for done, _ in steps)


@pytest.mark.usefixtures("small")
def test_a_bound_holds_in_a_stream(log: Callable[..., Path]):
    """Assert that a coefficient ends at its bound, and the others are what they are given that."""
    settings = replace(CHOSEN, bounds={"alpha2": (0.5, np.inf)})
    path = log()
    found = identify_stream(path, settings=settings)
    at_bound = found.coefficients["alpha2"]
    assert (at_bound.value, at_bound.reason) == (0.5, "at its bound")
    assert_least_squares(found, in_memory(path, settings))


@pytest.mark.usefixtures("small")
def test_a_wrong_value_that_is_known_is_doubted(log: Callable[..., Path]):
    """Assert that what contradicts the head is said of the whole, and nothing counts as known."""
    result = identify_stream(log(), settings=replace(CHOSEN, known={"motor_inertia": 0.4}))
    assert any("contradicts the log" in warning for warning in result.warnings)
    assert {c.verdict for c in result.coefficients.values()} == {"undetermined"}


@pytest.mark.usefixtures("small")
def test_a_change_of_the_joint_shows(log: Callable[..., Path], columns: dict[str, np.ndarray]):
    """Assert that a spring that softens after the head widens its interval to hold both."""
    torque, time = columns["motor_torque"], columns["time"]
    soft = {**TRUE, "theta2": 60.0, "alpha1": 200.0}
    states = free_run(flexible_joint(), soft, np.zeros(4), torque[30_000:], 1e-3)
    late = time >= 30.0
    link, motor = columns["link_position"].copy(), columns["motor_position"].copy()
    link[late], motor[late] = states[:, 0], states[:, 2]
    still = identify_stream(log(), settings=CHOSEN)
    path = log((30_000, 30_001), link_position=link, motor_position=motor)
    moved = identify_stream(path, settings=CHOSEN)
    for name in ("theta2", "alpha1"):
        lower, upper = moved.coefficients[name].interval
        assert lower < TRUE[name] < upper
        assert upper - lower > 100.0 * np.ptp(still.coefficients[name].interval)
    assert any("the drive changed" in warning for warning in moved.warnings)
    assert max(moved.residual_excess.values()) > 3.0 * max(still.residual_excess.values())


@pytest.mark.usefixtures("small")
def test_friction_that_needs_velocities(log: Callable[..., Path]):
    """Assert that velocities derived window by window serve as those derived at once.

    The window of the differentiator is chosen on the head alone.
    """
    terms = ("gravity", "motor_viscous", "motor_coulomb")
    settings = replace(CHOSEN, terms=terms, coulomb_velocity=0.1)
    path = log()
    found, expected = identify_stream(path, settings=settings), in_memory(path, settings)
    assert_least_squares(found, expected, share=0.3)


@pytest.mark.usefixtures("small")
def test_dry_friction_is_covered(log: Callable[..., Path]):
    """Assert that smoothing friction that is dry costs width, not truth, against the head's fit."""
    true = {**TRUE, "alpha_coulomb": 1.5}
    time = 1e-3 * np.arange(ROWS)
    torque = np.sin(np.outer(time, [1.0, 4.3, 7.4, 11.3])) @ np.array([1.5, 3.0, 4.0, 5.0])
    joint = flexible_joint((*CHOSEN.terms, "motor_coulomb"), coulomb_velocity=1e-3)
    states = free_run(joint, true, np.zeros(4), torque, 1e-3)
    noise = 1e-4 * np.random.default_rng(1).standard_normal((ROWS, 2))
    path = log(link_position=states[:, 0] + noise[:, 0], motor_position=states[:, 2] + noise[:, 1])
    result = identify_stream(path)
    assert "motor_coulomb" in result.choices.terms
    assert result.choices.coulomb_velocity is not None  # what it was smoothed over
    for name, value in true.items():
        lower, upper = result.coefficients[name].interval
        assert lower < value < upper


def test_what_a_stream_refuses(log: Callable[..., Path]):
    """Assert that a slow filter and a bad row are refused in a sentence."""
    path = log()
    with pytest.raises(SettingError, match="too slow for a stream"):
        identify_stream(path, settings=Settings(terms=("gravity",), hold="linear", filter_rate=0.1))
    bad = np.ones(ROWS)
    bad[50_000] = np.nan
    with pytest.raises(RecordingError, match="row 50001"):
        identify_stream(log(motor_torque=bad))
