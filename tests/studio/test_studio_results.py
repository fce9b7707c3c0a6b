"""Choices of a window from its address, and its results: files kept, replaced and removed."""

import asyncio
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass, field
from math import sin
from pathlib import Path
from typing import Any

import pytest

from flexid.errors import SettingError
from flexid.recording.recording import SI_UNITS
from flexid.studio import jobs
from flexid.studio.choices import Choices, Source, read_choices, read_play
from flexid.studio.jobs import JobError, Workers
from flexid.studio.window import Offer, Rooms, Window


def test_an_address_says_all():
    """Assert that every choice of a form is read, and that terms have one order."""
    values = {
        "column.motor_position": "q & <b>",
        "unit.motor_position": "deg",
        "scale.motor_position": "-0.5",
        "offset.motor_position": "1e-9",
        "column.time": "t",
        "gear_ratio": "101",
        "lead": "1/200",
        "model": "flexible",
        "hold": "zero",
        "terms": "motor_viscous,gravity,motor_viscous",
        "ran": "yes",
    }
    sources = {"motor_position": Source("q & <b>", "deg", -0.5, 1e-9), "time": Source("t")}
    terms = ("gravity", "motor_viscous")
    assert read_choices(values) == Choices(sources, 101.0, "flexible", "zero", terms, True, 0.005)
    assert read_choices({}) == Choices()
    assert read_choices({"terms": ""}).terms == ()  # other than in the log


@pytest.mark.parametrize(
    "values",
    [
        {"model": "../../etc/passwd"},
        {"hold": "<script>"},
        {"terms": "gravity,nonsense"},
        {"column.time": "t", "scale.time": "nan"},
        {"column.time": "t", "gear_ratio": "1/0"},
        {"column.time": "t", "offset.time": "1e999"},
        {"column.time": "t" * 1000},
        {f"key{i}": "" for i in range(1000)},
        "no mapping",
        None,
        {"reading": "9,9,9"},
    ],
)
def test_what_cannot_be_meant_is_refused(values: object):
    """Assert that an address with invalid values is refused in one sentence, in either room."""
    with pytest.raises(SettingError):
        [read(values) for read in (read_choices, read_play)]


def test_choices_as_a_column_map():
    """Assert a map of the differences from the file, without what is unknown or no text."""
    choices = read_choices({"column.time": "t", "column.motor_position": "q", "gear_ratio": "101"})
    assert choices.column_map == {
        **dict.fromkeys(SI_UNITS, False),
        "time": {"column": "t"},
        "motor_position": {"column": "q"},
        "gear_ratio": 101.0,
    }
    assert Choices().column_map is None
    assert read_choices({"column.time": "t", "gear_ratio": "1/101"}).gear_ratio == 1.0 / 101.0
    hostile = {"log": "../../etc/passwd", "column.password": "x", "ran": True, 3: "x", "model": 3}
    assert read_choices(hostile) == Choices()


class Here(Workers):
    """Workers that run jobs in this process at once; identification only leaves a trace."""

    def __init__(self) -> None:
        super().__init__(0)
        self.runs = 0
        self.hold: asyncio.Event | None = None
        self.exported: list[float] = []

    async def run(self, job: Callable[..., Any], *arguments: Any, folder: Path) -> Any:
        """Run a job."""
        if job is jobs.identify:
            return await self._identify(Path(arguments[2]), folder / arguments[0])
        if job is jobs.export:
            target, sample_time, into = arguments
            self.exported.append(sample_time)
            (Path(into) / f"{target}.zip").write_text((Path(into) / jobs.ESTIMATE).read_text())
            return f"{target}.zip", ("alpha2 <is> undetermined",)
        with pytest.MonkeyPatch.context() as patch:
            patch.chdir(folder)
            return job(*arguments)

    async def _identify(self, into: Path, log: Path) -> float:
        assert log.exists()
        self.runs += 1
        (into / jobs.ESTIMATE).write_text(f"run {self.runs}")
        (into / jobs.REPORT).write_text(f"run {self.runs}")
        if self.hold is not None:
            await self.hold.wait()
        return 1e-3  # s, sample time


@dataclass
class Opened:
    """A window without a page."""

    workers: Here = field(default_factory=Here)
    sent: list[dict[str, Any]] = field(default_factory=list)

    def __post_init__(self) -> None:
        offer = Offer(None, self.workers, self.workers, self.workers)
        self.window = Window(offer, self._send)
        self.rooms = Rooms(self.window)
        self.room = self.rooms.identify

    async def _send(self, message: dict[str, Any]) -> None:
        self.sent.append(message)

    async def ask(self, kind: str, values: object = None, target: object = None) -> None:
        """Send a request as the page does."""
        await self.rooms.handle({"kind": kind, "values": values, "target": target})

    async def idle(self) -> None:
        """Wait until all work has ended."""
        while running := [task for task in self.window._tasks.values() if not task.done()]:
            await asyncio.gather(*running)

    def upload(self, name: str, header: str = "time,motor_position,link_position") -> Path:
        """Upload a log."""
        path = self.window.folder / name
        rows = (f"{k / 1000},{sin(k / 20)},{1.1 * sin(k / 20)}\n" for k in range(400))
        path.write_text(f"{header}\n" + "".join(rows))
        self.room.uploaded(path)
        return path

    async def identify(self, name: str) -> Path:
        """Upload a log and identify it."""
        path = self.upload(name)
        await self.idle()
        await self.ask("run", {})
        await self.idle()
        return path

    def shown(self, place: str) -> str:
        """Return the content of a place on the page."""
        return [m["html"] for m in self.sent if m["kind"] == "show" and m["place"] == place][-1]


pytestmark = pytest.mark.anyio


@pytest.fixture
async def studio() -> AsyncIterator[Opened]:
    """Return a window that is closed after the test."""
    found = Opened()
    yield found
    await found.window.close()


async def test_a_result_replaces_another_with_its_exports(studio: Opened):
    """Assert that the next result replaces an earlier one and its exports."""
    await studio.identify("a.csv")
    for target in ("mjcf", "c99"):
        await studio.ask("export", target=target)
        await studio.idle()
    assert {"mjcf.zip", "c99.zip"} <= {*studio.window.files}
    assert all(f">{name}.zip<" in studio.shown("export-state") for name in ("mjcf", "c99"))
    await studio.ask("run", {})
    await studio.idle()
    assert "Done in" in studio.shown("run-state")
    assert sorted(studio.window.files) == ["estimate.json", "report.html"]
    assert studio.window.files["estimate.json"].read_text() == "run 2"
    assert len([*studio.window.folder.glob("run-*")]) == 1


async def test_a_cancelled_run_leaves_what_is_shown(studio: Opened):
    """Assert that files and exports stay those of the result on the page after a cancelled run."""
    await studio.identify("a.csv")
    studio.workers.hold = asyncio.Event()
    await studio.ask("run", {})
    while studio.workers.runs < 2:
        await asyncio.sleep(0)
    await studio.ask("cancel")
    await asyncio.gather(*studio.window._alive, return_exceptions=True)
    await studio.ask("export", target="mjcf")
    await studio.idle()
    files = studio.window.files
    assert {path.read_text() for path in files.values()} == {"run 1"}
    assert sorted(files) == ["estimate.json", "mjcf.zip", "report.html"]


async def test_other_columns_do_not_change_what_was_found(studio: Opened):
    """Assert that other columns are checked, and that exports still use the earlier result."""
    await studio.identify("a.csv")
    names = "time", "motor_position", "link_position"
    columns = {f"column.{name}": name for name in names}
    await studio.ask("columns", {**columns, "scale.time": "10"})
    await studio.idle()
    assert "100 Hz" in studio.shown("check")
    await studio.ask("export", target="c99")
    await studio.idle()
    assert studio.workers.exported == [1e-3]
    assert "<li>alpha2 &lt;is&gt; undetermined</li>" in studio.shown("export-state")


async def test_logs_replace_each_other(studio: Opened, short_log: Path):
    """Assert that an upload replaces another, and not the log of the command line."""
    first = await studio.identify("a.csv")
    second = studio.upload("b.csv")
    await studio.idle()
    assert not first.exists()
    assert [*studio.window.folder.iterdir()] == [second]
    assert studio.window.files == {}
    studio.window.offer = Offer(short_log, *[studio.workers] * 3)
    await studio.room.open({"model": "nonsense"})
    await studio.idle()
    assert "is not one of auto" in studio.shown("log-problem")
    studio.upload("a.csv")
    await studio.idle()
    assert short_log.exists()


async def test_a_defect_is_shown_where_the_work_was(studio: Opened):
    """Assert that an unexpected error is shown in one sentence."""

    async def broken() -> None:
        raise KeyError("oh")

    studio.window.start("run", broken(), "run-state")
    await studio.idle()
    assert "a defect of flexid (KeyError" in studio.shown("run-state")


async def test_a_window_is_closed_after_its_work():
    """Assert that late work still finds the folder, which is then removed."""
    window, found = Opened().window, []

    async def work() -> None:
        try:
            await asyncio.sleep(60)
        finally:
            await asyncio.sleep(0)
            found.append(window.folder.exists())
            (window.folder / "late").mkdir(parents=True)

    window.start("run", work(), "run-state")
    await asyncio.sleep(0)
    await window.close()
    assert found == [True]
    assert not window.folder.exists()


@pytest.mark.parametrize("values", [{"k": "bad"}, {}])
async def test_play_goes_on_after_an_error(studio: Opened, values: dict[str, str]):
    """Assert that a failed run is answered, as the page waits for each answer."""

    class Broken(Workers):
        async def run(self, *_: Any, **__: Any) -> Any:
            raise JobError("the work ended early")

    studio.window.offer = Offer(None, *[Broken(0)] * 3)
    await studio.ask("play", values)
    await studio.idle()
    assert "problem" in studio.shown("play-problem")
    assert {"kind": "played"} in studio.sent
