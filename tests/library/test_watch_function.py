"""`flexid.watch`: fed or following, as the command is."""

from pathlib import Path

import numpy as np
import pytest

import flexid
from flexid.errors import ArgumentError, RecordingError
from flexid.streaming import incoming

LOG = Path("examples/flexible_joint.csv")
PAPER = {"terms": ("gravity", "motor_viscous"), "hold": "linear"}


@pytest.fixture(scope="module")
def samples():
    """Samples of the example."""
    return flexid.samples(LOG)[0]


def channels(samples, part=slice(None)):
    """Channels as keywords."""
    return {
        "link_position": samples.positions[part, 0],
        "motor_position": samples.positions[part, 1],
        "motor_torque": samples.inputs[part, 0],
    }


def test_fed_one_by_one(samples):
    """Assert that samples may come as plain numbers, and that reading changes nothing."""
    one, block = flexid.watch(sample_time=1e-3, **PAPER), flexid.watch(sample_time=1e-3, **PAPER)
    assert one.health.health is flexid.Health.CONVERGING
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
    """Assert that a turn with all that came before precedes the error."""
    text = "".join(LOG.read_text().splitlines(keepends=True)[:3001])

    def fails(*_, **__):
        yield text.encode()
        raise OSError(5, "Input/output error")

    monkeypatch.setattr(incoming, "open_source", fails)
    log = tmp_path / "log.csv"
    watch = iter(flexid.watch(log, every=10.0, **PAPER))
    assert next(watch).counts.taken == 3000
    with pytest.raises(RecordingError, match=r"cannot be read on \(Input/output error\)"):
        next(watch)


@pytest.mark.parametrize(
    ("samples", "words"),
    [
        ({"motor_position": [1.0, 2.0], "motor_torque": [1.0]}, "differ in number"),
        ({"motor_position": "x", "motor_torque": 1.0}, "motor_position is a str"),
        ({"motor_position": [[1.0]], "motor_torque": 1.0}, "has 2 dimensions"),
    ],
)
def test_samples_that_cannot_be(samples, words):
    """Assert that each is refused with what would be right."""
    with pytest.raises(ArgumentError, match=words):
        flexid.watch(sample_time=1e-3).feed(**samples)


def test_a_source_or_samples(samples):
    """Assert that what has a source is not fed, and what has none is not followed."""
    watch = flexid.watch(sample_time=1e-3, **PAPER)
    watch.feed(**channels(samples, slice(10)))
    with pytest.raises(ArgumentError, match="give the same"):
        watch.feed(motor_position=np.zeros(3), motor_torque=np.zeros(3))
    with pytest.raises(ArgumentError, match="come from the source"):
        flexid.watch(LOG).feed(motor_position=0.0, motor_torque=0.0)
    with pytest.raises(ArgumentError, match="source is missing"):
        next(iter(flexid.watch(sample_time=1e-3)))
