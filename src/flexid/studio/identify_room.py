"""Room for identification: the log, its columns, checks and the result."""

from __future__ import annotations

import json
import shutil
import tempfile
from dataclasses import replace
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Any

from flexid.errors import FlexidError
from flexid.models.motion import JOINT_TYPES
from flexid.recording.recording import INPUTS, SI_UNITS, si_units
from flexid.recording.units import EXAMPLES
from flexid.studio import jobs
from flexid.studio.choices import HOLDS, MODELS, Choices, Source, read_choices

if TYPE_CHECKING:
    from flexid.recording.series import FileOverview
    from flexid.studio.window import Window

_BUSY = "Identifying ... (the first run on a machine compiles for up to a minute)"
EXPORTS = {
    "c99": "the online estimator in C99",
    "fmu": "the plant as FMUs",
    "mjcf": "the joint as a MuJoCo scene",
}
_PLACES = ("columns", "check", "check-charts", "run", "run-state", "result")


class IdentifyRoom:
    """Identification room of one window."""

    def __init__(self, window: Window) -> None:
        self._window = window
        self._choices = Choices()
        self._log: Path | None = None
        self._overview: FileOverview | None = None
        self._shown: Path | None = None  # folder of the result on the page
        self._sample_time = 0.0  # s, of the log of that result

    async def open(self, values: object) -> None:
        """Start with the choices in an address, and with the log of the command line."""
        try:
            self._choices = read_choices(values)
        except FlexidError as error:
            await self._window.show("log-problem", "problem.html", text=str(error))
        log = self._window.offer.log
        if log is not None:
            self._take(log)

    def uploaded(self, path: Path) -> None:
        """Switch to an uploaded log."""
        self._choices = replace(self._choices, ran=False)
        self._take(path)

    async def on_columns(self, values: object, _target: object) -> None:
        """Read the forms and check the log again."""
        await self._set(values)
        if self._log is not None:
            self._window.start("check", self._check(), "check")

    async def on_settings(self, values: object, _target: object) -> None:
        """Read the forms; the columns are unchanged, so the log is not checked again."""
        await self._set(values)

    async def on_run(self, values: object, _target: object) -> None:
        """Read the forms and start an identification."""
        await self._set(values)
        if self._log is not None:
            self._window.start("run", self._run(), "run-state")

    async def on_cancel(self, _values: object, _target: object) -> None:
        """Cancel the identification."""
        if self._window.cancel("run"):
            await self._window.show("run-state", "run_state.html", text="Cancelled.", busy=False)

    async def on_export(self, _values: object, target: object) -> None:
        """Export the result for another tool."""
        if isinstance(target, str) and target in EXPORTS and self._shown is not None:
            self._window.start("export", self._export(target, self._shown), "export-state")

    async def _set(self, values: object) -> None:
        """Read the choices from the forms; show the error and raise if they are invalid."""
        try:
            self._choices = replace(read_choices(values), ran=self._choices.ran)
        except FlexidError as error:
            await self._window.show("check", "problem.html", text=str(error))
            await self._window.show("check-charts", "nothing.html")
            raise
        found = self._overview
        if (
            found is not None
            and not found.unclear
            and self._choices.gear_ratio is self._choices.lead is None
            and self._choices.sources == _sources_by_name(found)
        ):
            self._choices = replace(self._choices, sources={})  # keeps links short

    def _take(self, path: Path) -> None:
        for name in ("check", "run", "export"):
            self._window.cancel(name)
        before, self._log, self._overview = self._log, path, None
        if before not in (None, path, self._window.offer.log):
            before.unlink(missing_ok=True)  # an uploaded copy
        self._keep(None, [])
        self._window.start("look", self._look(path), "log-problem")

    async def _look(self, path: Path) -> None:
        window = self._window
        for place in _PLACES:
            await window.show(place, "nothing.html")
        await window.show("log-state", "line.html", text=f"Reading {path.name} ...")
        found: FileOverview = await window.offer.short.run(jobs.look, path.name, folder=path.parent)
        self._overview = found
        self._keep_sources(found)
        await window.show("log-state", "log_state.html", name=path.name, found=found)
        await window.show(
            "columns",
            "columns.html",
            found=found,
            sources=self._choices.sources or _sources_by_name(found),
            gear_ratio=self._choices.gear_ratio,
            lead=self._choices.lead,
            channels=SI_UNITS,
            units={
                channel: [
                    unit
                    for si in dict.fromkeys(
                        si for joint in JOINT_TYPES for si in si_units(channel, joint)
                    )
                    for unit in EXAMPLES[si]
                ]
                for channel in SI_UNITS
            },
            inputs=INPUTS,
            by_name=not self._choices.sources,
            open_question=self._open_question,
        )
        if not self._open_question:
            window.start("check", self._check(), "check")

    @property
    def _open_question(self) -> str:
        """Ambiguity in the names of the columns; empty once the user has chosen columns."""
        found = self._overview
        is_open = found is not None and self._choices.sources == _sources_by_name(found)
        return found.unclear if found is not None and is_open else ""

    def _keep_sources(self, found: FileOverview) -> None:
        """Drop columns of another log; if names are ambiguous, start with the clear ones."""
        headers = {column.header for column in found.columns}
        if any(source.column not in headers for source in self._choices.sources.values()):
            self._choices = replace(self._choices, sources={}, gear_ratio=None, lead=None)
        if found.unclear and not self._choices.sources:
            self._choices = replace(self._choices, sources=_sources_by_name(found))

    async def _check(self) -> None:
        window, log = self._window, self._log
        if log is None or self._overview is None:
            return
        await window.show("check", "line.html", text="Checking the log ...")
        try:
            found: jobs.Checked = await window.offer.short.run(
                jobs.check, log.name, self._choices, folder=log.parent
            )
        except FlexidError as error:
            await window.show("check-charts", "nothing.html")
            await window.show("run", "nothing.html")
            await window.show("check", "unread.html", text=str(error))
            return
        await window.show(
            "columns-state", "columns_state.html", found=self._overview,
            by_name=not self._choices.sources, open_question="",
        )  # fmt: skip
        await window.show("check", "check.html", found=found)
        await window.show("check-charts", "drawn.html", figure=found.figure)
        await window.show(
            "run", "run.html", choices=self._choices, models=MODELS, holds=HOLDS, found=found
        )
        if self._choices.ran and self._shown is None:
            window.start("run", self._run(), "run-state")

    async def _run(self) -> None:
        window, log, choices = self._window, self._log, self._choices
        if log is None:
            return
        begun = monotonic()
        await window.show("run-state", "run_state.html", text=_BUSY, busy=True)
        folder = Path(tempfile.mkdtemp(prefix="run-", dir=window.folder))
        try:
            sample_time: float = await window.offer.long.run(
                jobs.identify, log.name, choices, str(folder), folder=log.parent
            )
            files = [folder / name for name in (jobs.REPORT, jobs.ESTIMATE)]
            if choices.column_map is not None:
                files.append(_write_map(choices, folder))
        except BaseException:  # the result on the page keeps its files
            shutil.rmtree(folder, ignore_errors=True)
            raise
        window.cancel("export")  # of the previous result
        self._keep(folder, files)
        self._sample_time = sample_time
        self._choices = replace(self._choices, ran=True)
        await window.show("run-state", "done.html", seconds=monotonic() - begun)
        await window.show("result", "result.html", files=[*window.files], exports=EXPORTS)

    def _keep(self, shown: Path | None, files: list[Path]) -> None:
        """Offer the files of a new result, and delete those of the previous one."""
        if self._shown is not None:
            shutil.rmtree(self._shown, ignore_errors=True)
        self._shown, self._window.files = shown, {path.name: path for path in files}

    async def _export(self, target: str, shown: Path) -> None:
        window = self._window
        await window.show("export-state", "run_state.html", text="Writing ...", busy=False)
        name, warnings = await window.offer.long.run(
            jobs.export, target, self._sample_time, str(shown), folder=shown
        )
        window.files[name] = shown / name
        names = [one for one in window.files if one.endswith(".zip")]
        await window.show("export-state", "exported.html", names=names, warnings=warnings)


def _sources_by_name(found: FileOverview) -> dict[str, Source]:
    """Return the channels' columns according to the names of the columns."""
    units = {column.header: column.unit for column in found.columns}
    return {
        channel: Source(header, units.get(header, "")) for channel, header in found.channels.items()
    }


def _write_map(choices: Choices, folder: Path) -> Path:
    """Write the choices as a column map for the command line, and return its path."""
    path = folder / "columns.toml"
    lines = (f"{key} = {_as_toml(entry)}\n" for key, entry in (choices.column_map or {}).items())
    path.write_text("".join(lines), encoding="utf-8")
    return path


def _as_toml(value: Any) -> str:
    """Return a table, text, number or truth value in TOML, which writes the last three as JSON."""
    if not isinstance(value, dict):
        return json.dumps(value, ensure_ascii=False)
    return f"{{ {', '.join(f'{key} = {_as_toml(each)}' for key, each in value.items())} }}"
