"""Streams that are watched for windows, piece by piece."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from flexid.errors import RecordingError, SettingError
from flexid.simulation.sampled import Sampling, simulate_sampled
from flexid.studio import live_drive, live_jobs
from flexid.studio.choices import Choices
from flexid.studio.live_choices import DRIVE, FOLLOW, REPLAY, LiveChoices, read_live
from flexid.studio.live_drive import LOAD, OPTIONS, PIECE, SimulatedDrive
from flexid.studio.live_jobs import begin, forget, go_on
from flexid.studio.workers import JobError

ALL = (DRIVE, REPLAY, FOLLOW)
CHOSEN = Choices()


@pytest.fixture(autouse=True)
def streams(monkeypatch: pytest.MonkeyPatch) -> Iterator[dict]:
    """Return the streams of a process that has none."""
    found: dict = {}
    monkeypatch.setattr(live_jobs, "_STREAMS", found)
    yield found
    for key in [*found]:
        forget(print, key)


def seen(key: str, choices: LiveChoices) -> live_jobs.Seen:
    """What is known after a piece."""
    found = go_on(print, key, choices)
    assert found is not None
    return found


def pieces(count: int) -> np.ndarray:
    """The first pieces of a drive without a load, shape (count, n, 4)."""
    drive = SimulatedDrive()
    return np.array([drive.piece(loaded=False, unplugged=False) for _ in range(count)])


def test_pieces_are_those_of_one_run(monkeypatch: pytest.MonkeyPatch):
    """Assert that a drive goes on where it was, and that no two pieces have the same noise."""
    noisy = pieces(3)
    quiet = Sampling(OPTIONS.sample_time, 60.0)
    monkeypatch.setattr(live_drive, "_SAMPLING", quiet)
    clean = pieces(3)
    run = simulate_sampled(SimulatedDrive()._loop, 3 * PIECE, quiet)
    joined = clean.reshape(-1, 4)
    assert joined[:, 0] == pytest.approx(run.time[:-1])
    assert joined[:, 1] == pytest.approx(run.states[:-1, 0], abs=1e-9)
    assert joined[:, 2] == pytest.approx(run.states[:-1, 2], abs=1e-9)
    assert joined[:, 3] == pytest.approx(run.inputs[:-1, 0], abs=1e-6)
    noise = (noisy - clean)[:, :, 1]
    assert 2e-4 < noise.std() < 5e-3
    assert np.abs(np.corrcoef(noise) - np.eye(3)).max() < 0.5


def test_an_unplugged_encoder_stands_still_and_comes_back():
    """Assert that it holds what it showed last, over pieces, while the motor's moves."""
    drive = SimulatedDrive()
    drive.piece(loaded=False, unplugged=False)
    held = np.concatenate([drive.piece(loaded=False, unplugged=True) for _ in range(2)])
    after = drive.piece(loaded=False, unplugged=False)
    assert np.ptp(held[:, 1]) == 0.0
    assert np.ptp(held[:, 2]) > 0.1
    assert np.ptp(after[:, 1]) > 0.01


def test_the_estimates_follow_the_drive():
    """Assert that they converge to the true values, and after a load to the new ones."""
    begin(print, "a", DRIVE, "", CHOSEN)
    plain, loaded = LiveChoices(pace=4), LiveChoices(pace=4, loaded=True)
    seen("a", plain)
    seen("a", plain)
    found = seen("a", plain)
    assert (found.health, found.tone, found.ended) == ("converged", "good", False)
    values = {row.name: float(row.value) for row in found.rows}
    assert values["link_inertia"] == pytest.approx(1.0, rel=0.05)
    words = {seen("a", loaded).health for _ in range(3)}
    assert "inconsistent" in words
    found = seen("a", loaded)
    values = {row.name: float(row.value) for row in found.rows}
    assert found.health == "converged"
    assert values["link_inertia"] == pytest.approx(LOAD, rel=0.05)
    assert found.truth["link_inertia"] == "1.5"
    assert any("load" in text for text in found.remarks)
    found = seen("a", LiveChoices(pace=4, loaded=True, unplugged=True))
    assert (found.health, found.tone) == ("sensor fault", "bad")
    assert "of a stuck encoder" in found.samples


def test_the_history_stays_short(monkeypatch: pytest.MonkeyPatch, streams: dict):
    """Assert that it keeps its first and latest moments and never more than it may."""
    monkeypatch.setattr(live_jobs, "MOST_MOMENTS", 10)
    begin(print, "a", DRIVE, "", CHOSEN)
    found, moments = seen("a", LiveChoices(pace=16)), streams["a"][1]
    for _ in range(2):
        found = seen("a", LiveChoices(pace=16))
        assert len(moments) <= 10
    times = [moment.time for moment in moments]
    assert times == sorted({*times})
    assert times[0] == pytest.approx(PIECE, abs=2e-3)
    assert times[-1] == found.time


def test_a_log_is_played_again_to_its_end(short_log: Path, monkeypatch: pytest.MonkeyPatch):
    """Assert that it comes in pieces, says when it ends, and has no true values."""
    monkeypatch.chdir(short_log.parent)
    begin(print, "a", REPLAY, short_log.name, CHOSEN)
    found = seen("a", LiveChoices(REPLAY, 4))
    assert found.time == pytest.approx(4 * PIECE, abs=2e-3)
    assert not found.ended
    while not found.ended:
        found = seen("a", LiveChoices(REPLAY, 4))
    assert "4000 of 4000" in found.samples
    assert found.truth == {}


def test_a_log_that_grows_is_followed(
    short_log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """Assert that what has come is taken in, and more when it comes."""
    monkeypatch.chdir(tmp_path)
    lines = short_log.read_text().splitlines(keepends=True)
    path = Path("growing.csv")
    path.write_text("".join(lines[:100]))
    begin(print, "a", FOLLOW, path.name, CHOSEN)
    choices = LiveChoices(FOLLOW)
    assert go_on(print, "a", choices) is None
    for end in (3001, 4001):
        with path.open("a") as file:
            file.write("".join(lines[100 if end == 3001 else 3001 : end]))
        found = seen("a", choices)
        while found.time < (end - 2) * 1e-3 - 1e-6:
            found = seen("a", choices)
        assert not found.ended
    assert "4000 of 4000" in found.samples


def test_what_cannot_be_watched_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Assert that a log of words, an empty one and a stream that is lost end in a sentence."""
    monkeypatch.chdir(tmp_path)
    Path("words.csv").write_text("<script>,b\n" + "x,y\n" * 300)
    Path("empty.csv").write_text("")
    for name in ("words.csv", "empty.csv"):
        begin(print, "a", REPLAY, name, CHOSEN)
        with pytest.raises((RecordingError, JobError)):
            go_on(print, "a", LiveChoices(REPLAY))
        with pytest.raises(JobError, match="start it again"):
            go_on(print, "a", LiveChoices(REPLAY))


def test_streams_are_bounded_and_apart(streams: dict):
    """Assert that a window has one, that there is a most, and that forgetting makes room."""
    for place in range(live_jobs.MOST_STREAMS):
        begin(print, str(place), DRIVE, "", CHOSEN)
    begin(print, "0", DRIVE, "", CHOSEN)
    with pytest.raises(JobError, match="stop one"):
        begin(print, "more", DRIVE, "", CHOSEN)
    assert seen("1", LiveChoices(pace=4)).time > seen("2", LiveChoices()).time
    forget(print, "3")
    forget(print, "never begun")
    begin(print, "more", DRIVE, "", CHOSEN)
    assert len(streams) == live_jobs.MOST_STREAMS


def test_an_address_says_all():
    """Assert that what an address holds comes back from it, and another source is no path."""
    values = {"room": "live", "source": "replay", "pace": "16", "loaded": "yes"}
    chosen = read_live(values, ALL)
    assert chosen == LiveChoices(REPLAY, 16, loaded=True)
    pairs = dict(pair.split("=") for pair in chosen.query.split("&"))
    assert read_live(pairs, ALL) == chosen
    assert read_live({}, (DRIVE,)) == LiveChoices()


@pytest.mark.parametrize(
    "values",
    [None, {"source": "/etc/passwd"}, {"pace": "3"}, {"pace": "1e9"}],
)
def test_what_cannot_be_meant_is_refused(values: object):
    """Assert that it is answered in a sentence."""
    with pytest.raises(SettingError):
        read_live(values, ALL)


def test_without_a_log_there_is_none():
    """Assert that where no log is, none can be chosen."""
    with pytest.raises(SettingError, match="flexid studio LOG"):
        read_live({"source": "replay"}, (DRIVE,))


def test_a_folder_that_is_gone_ends_no_process():
    """Assert that streams live on when a window's folder vanished before its job began."""
    import asyncio

    from flexid.studio.workers import Workers

    async def main() -> None:
        workers = Workers(1)
        try:
            here = Path.cwd()
            await workers.run(begin, "a", DRIVE, "", CHOSEN, folder=here, said=print)
            with pytest.raises(JobError):
                await workers.run(forget, "a", folder=here / "gone", said=print)
            found = await workers.run(go_on, "a", LiveChoices(), folder=here, said=print)
            assert found.time > 0.0
        finally:
            workers.end()

    asyncio.run(main())
    assert os.getcwd()
