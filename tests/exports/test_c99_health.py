"""The estimator in C99 at run time: health, gaps, and a saved state."""

import ctypes
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from drive import STRICT, run, tool

import flexid
from flexid.simulation.free_run import free_run

H = 1e-3
TRUE = {"theta1": 5.0, "theta2": 100.0, "alpha1": 333.0, "alpha2": 0.33, "beta1": 3.3}
CONVERGING, CONVERGED, NOT_EXCITED, INCONSISTENT, SENSOR_FAULT = range(5)


class Drive:
    """An estimation in C with samples from Python."""

    def __init__(self, library: Path, number: Any = ctypes.c_double) -> None:
        self._number = number
        self._c = ctypes.CDLL(str(library))
        self._c.flexid_checksum.restype = ctypes.c_uint32
        self._c.flexid_restore.restype = ctypes.c_bool
        self._c.flexid_restore.argtypes = [ctypes.c_void_p, ctypes.c_uint32]
        self.state = ctypes.create_string_buffer(1 << 16)  # larger than a state
        self._c.flexid_init(self.state)

    def feed(self, samples: np.ndarray) -> list[int]:
        """Process samples; return the health after each."""
        return [self._c.flexid_step(self.state, (self._number * 3)(*row)) for row in samples]

    def gap(self) -> None:
        """Report missed samples."""
        self._c.flexid_gap(self.state)

    def checksum(self) -> int:
        """Return the checksum of the state."""
        return self._c.flexid_checksum(self.state)

    def restore(self, saved: bytes, checksum: int) -> bool:
        """Restore a saved state; return whether it is valid."""
        self.state.raw = saved
        return self._c.flexid_restore(self.state, checksum)

    @property
    def estimates(self) -> dict[str, float]:
        """Return estimates by coefficient."""
        values = (self._number * len(TRUE))()
        self._c.flexid_estimates(self.state, values)
        return dict(zip(TRUE, values, strict=True))


def built(folder: Path, *options: str, **settings: Any) -> Path:
    """Build an exported estimator as a library."""
    flexid.export("flexible-joint", to="c99", out=folder, sample_time=H, **settings)
    source, library = folder / "flexid_drive.c", folder / "drive.so"
    run(tool("gcc"), *STRICT, "-O2", *options, "-fPIC", "-shared", source, "-lm", "-o", library)
    return library


@pytest.fixture(scope="module")
def drive(tmp_path_factory) -> Callable[[], Drive]:
    """Return a function that creates new estimations."""
    library = built(tmp_path_factory.mktemp("health"))
    return lambda: Drive(library)


def motion(duration: float, values: dict[str, float] = TRUE, state=(0.0,) * 4) -> np.ndarray:
    """Return states under two sines and the input, shape (n, 5)."""
    time = H * np.arange(round(duration / H))
    torque = 20.0 * np.sin(2.0 * time) + 10.0 * np.sin(5.3 * time)
    system = flexid.flexible_joint()
    return np.column_stack((free_run(system, values, state, torque, H, "zero"), torque))


def measured(states: np.ndarray) -> np.ndarray:
    """Return the measurements of encoders and current controller: link, motor, torque."""
    return states[:, [0, 2, 4]]


def test_it_converges(drive):
    """Assert that coefficients converge, and that the health is `CONVERGED` only then."""
    estimation = drive()
    health = estimation.feed(measured(motion(5.0)))
    assert health[10] == CONVERGING
    assert set(health[2000:]) == {CONVERGED}
    assert estimation.estimates == pytest.approx(TRUE, rel=1e-3)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1e10, -1e300])
@pytest.mark.parametrize("channel", [0, 1, 2])
def test_a_fault_is_left_out(drive, bad, channel):
    """Assert that an invalid sample is flagged and leaves the estimates unchanged."""
    estimation = drive()
    samples = measured(motion(3.0))
    estimation.feed(samples[:2500])
    before = estimation.estimates
    wrong = samples[2500:2501].copy()
    wrong[0, channel] = bad
    assert estimation.feed(wrong) == [SENSOR_FAULT]
    assert estimation.estimates == before
    assert SENSOR_FAULT not in estimation.feed(samples[2501:])
    assert estimation.estimates == pytest.approx(TRUE, rel=1e-3)


SINES = np.sin(np.outer(H * np.arange(4000), [5.0, 5.0, 3.0]))


@pytest.mark.parametrize(
    ("samples", "given_time"),
    [
        (np.zeros((4000, 3)), True),
        (np.random.default_rng(3).normal(0.0, 1e-4, (4000, 3)), False),  # independent regressors
        (SINES * [0.01, 0.013, 1.0], True),  # the deflection is proportional to the link's sine
    ],
    ids=["standstill", "noise", "confounded"],
)
def test_what_determines_nothing_is_not_excited(drive, samples, given_time):
    """Assert that uninformative samples first count as converging, and then as not excited."""
    health = drive().feed(samples)
    assert not given_time or set(health[:1900]) == {CONVERGING}
    assert set(health[2100:]) == {NOT_EXCITED}


@pytest.mark.thorough
def test_an_overflow_is_flagged(tmp_path):
    """Assert that an overflow in float restarts the estimation, with a flag."""
    library = built(tmp_path, "-DFLEXID_FLOAT", terms=("gravity", "cubic_stiffness"))
    estimation = Drive(library, ctypes.c_float)
    wild = 1e9 * np.array([[1.0, -1.0, 1.0], [-1.0, 1.0, 1.0]] * 10)
    assert SENSOR_FAULT in estimation.feed(wild)
    assert all(map(math.isfinite, estimation.estimates.values()))


def test_a_changed_drive_is_inconsistent(drive):
    """Assert that a softer spring is detected within two seconds, without an earlier alarm."""
    first = motion(10.0)
    softer = motion(4.0, TRUE | {"theta2": 50.0, "alpha1": 166.0}, first[-1, :4])
    estimation = drive()
    assert INCONSISTENT not in estimation.feed(measured(first))
    health = estimation.feed(measured(softer))
    assert INCONSISTENT in health[:2000]


def test_rest_and_gaps_do_no_harm(drive):
    """Assert that rest is no changed drive, and right estimates after gaps that restart filters."""
    noise = np.random.default_rng(5).normal(0.0, 1e-4, (10_000, 3)) * [1.0, 1.0, 0.0]
    estimation = drive()
    estimation.feed(measured(motion(6.0)) + noise[:6000])
    estimation.gap()
    assert set(estimation.feed(noise[6000:])[100:]) == {CONVERGED}
    samples = measured(motion(12.0))
    noise = np.random.default_rng(4).normal(0.0, 1e-4, samples.shape) * [1.0, 1.0, 0.0]
    estimation = drive()
    for part in np.array_split(samples + noise, 24):
        estimation.feed(part)
        estimation.gap()
    found = np.array([*estimation.estimates.values()]) / [*TRUE.values()]
    assert np.abs(found - 1.0).max() < 0.003


def test_a_saved_state_is_taken_up(drive):
    """Assert that estimates survive a power cycle, after which the filter restarts."""
    samples = measured(motion(6.0))
    estimation = drive()
    estimation.feed(samples[:3000])
    saved, checksum, found = estimation.state.raw, estimation.checksum(), estimation.estimates
    fresh = drive()
    assert fresh.restore(saved, checksum)
    assert fresh.estimates == found
    fresh.feed(samples[4500:])
    assert fresh.estimates == pytest.approx(TRUE, rel=1e-3)


@pytest.mark.parametrize(("place", "checked_after"), [(0, 0), (40, 0), (500, 0), (0, 1)])
def test_another_state_is_refused(drive, place, checked_after):
    """Assert that a flipped bit restarts the estimation; in the version, with any checksum."""
    estimation = drive()
    estimation.feed(measured(motion(1.0)))
    checksum = estimation.checksum()
    damaged = bytearray(estimation.state.raw)
    damaged[place] ^= 1
    if checked_after:
        estimation.state.raw = bytes(damaged)
        checksum = estimation.checksum()
    fresh = drive()
    assert not fresh.restore(bytes(damaged), checksum)
    assert fresh.estimates == dict.fromkeys(TRUE, 0.0)
