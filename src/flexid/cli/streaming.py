"""``flexid identify --stream``: one log of any length, with a progress bar."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from flexid.errors import SettingError
from flexid.identification.preparation.settings import Settings
from flexid.identification.result.identification import Identification

if TYPE_CHECKING:
    from rich.console import Console


def identify_with_bar(
    logs: Sequence[Path], columns: Path | None, settings: Settings, console: "Console"
) -> Identification:
    """Stream a log, and show how far it is, how fast, and how long it will take."""
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn
    from rich.progress import TimeRemainingColumn as TimeLeft

    from flexid.streaming.whole_log import identify_stream

    if len(logs) != 1:
        raise SettingError("stream", "only one log can be streamed: name one Parquet file")
    rate = TextColumn("{task.fields[rate]}")
    step = TextColumn("{task.description}")
    columns_shown = (step, BarColumn(), TaskProgressColumn(), rate, TimeLeft())
    shown = console.is_terminal  # elsewhere a line without anything would be left
    with Progress(*columns_shown, console=console, transient=True, disable=not shown) as progress:
        task = progress.add_task("reading", total=None, rate="")

        def advance(done: int, total: int) -> None:
            progress.update(task, completed=done, total=total)
            speed = progress.tasks[0].speed
            if speed:
                progress.update(task, rate=f"{speed / 1e6:.1f} million samples/s")

        return identify_stream(
            logs[0],
            columns,
            settings,
            lambda words: progress.update(task, description=words),
            advance,
        )
