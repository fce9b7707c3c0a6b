"""`flexid.watch`, with samples fed or a source followed, as the command."""

from functools import partial
from pathlib import Path

import pytest

import flexid
from flexid.errors import RecordingError
from flexid.streaming import incoming

LOG = Path("examples/flexible_joint.csv")
PAPER = {"terms": ("gravity", "motor_viscous"), "hold": "linear"}


@pytest.fixture(scope="module")
def samples():
    """Return the samples of the example."""
    return flexid.samples(LOG)[0]


def channels(samples, part=slice(None)):
    """Return the channels as keywords."""
    return {
        "link_position": samples.positions[part, 0],
        "motor_position": samples.positions[part, 1],
        "motor_torque": samples.inputs[part, 0],
    }


def test_fed_one_by_one(samples):
    """Assert that samples may be plain numbers, and that reading results changes nothing."""
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
    """Assert that all samples before a read error are processed."""
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


def test_what_is_not_fed_or_followed(samples, refusals):
    """Assert that a followed source cannot be fed, and that bad samples or sources are refused."""
    watch, unfed = (flexid.watch(sample_time=1e-3, **PAPER) for _ in range(2))
    watch.feed(**channels(samples, slice(10)))
    calls = {
        "other channels": lambda: watch.feed(motor_position=0.0, motor_torque=0.0),
        "a source": lambda: flexid.watch(LOG).feed(motor_position=0.0, motor_torque=0.0),
        "no source": lambda: next(iter(unfed)),
    }
    for name, position in {"two of one": [1.0, 2.0], "text": "x", "a matrix": [[1.0]]}.items():
        calls[name] = partial(unfed.feed, motor_position=position, motor_torque=[1.0])
    refusals(calls)
