"""How a result presents itself: one printer and one page serve every command."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from flexid.report.charts.description import Chart
    from flexid.report.page.layout import Page
    from flexid.report.terminal import Part


@dataclass(frozen=True)
class Presenter:
    """What there is to show of a kind of result; each function takes the result first."""

    parts: "Callable[..., Iterable[Part]]"  # tables and sentences
    document: "Callable[..., Mapping[str, Any]]"  # everything but the time series, for JSON
    charts: "Callable[..., Sequence[Chart]]" = lambda *_: ()  # the most important one first
    page: "Callable[..., Page] | None" = None  # takes the charts, the command and its folder too
    evidence: "Callable[..., Iterable[Part]]" = lambda *_: ()  # what choices rest on
    write_data: "Callable[..., None]" = lambda *_: None  # into a folder; whether as CSV, too
