"""What all answers have in common: text, a page of a notebook, a document, figures, files."""

from __future__ import annotations

import base64
import io
import json
from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from html import escape
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from flexid.arrays import to_json
from flexid.errors import SettingError
from flexid.library.arguments import entrance

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from flexid.library.arguments import FilePath
    from flexid.report.chart import Chart
    from flexid.report.page import Page, Presenter
    from flexid.report.terminal import Part


class Answer:
    """What a function of flexid returns: tables and a figure in a notebook, text in `summary`."""

    _report = ""  # the module of `flexid.report` that presents it
    _file = "result.json"  # among what the command writes
    _formats: tuple[str, ...] = ("png",)  # of the figures

    def __init__(self, result: Any) -> None:
        self.result = result  # what was found

    def __getattr__(self, name: str) -> Any:
        if not self._is_the_results(name):
            raise AttributeError(f"{type(self).__name__} has no {name!r}", name=name, obj=self)
        value = getattr(self.result, name)
        return MappingProxyType(value) if isinstance(value, dict) else value

    def __setattr__(self, name: str, value: Any) -> None:
        if self._is_the_results(name):
            raise AttributeError(f"{name!r} is what was found: it stays", name=name, obj=self)
        super().__setattr__(name, value)

    def _is_the_results(self, name: str) -> bool:
        """Whether a class declares an attribute that is that of the result."""
        every = (vars(each).get("__annotations__", ()) for each in type(self).__mro__)
        return name != "result" and not name.startswith("_") and any(name in one for one in every)

    @property
    def _presenter(self) -> Presenter:
        return import_module(f"flexid.report.{self._report}").PRESENTER

    @property
    def _shown(self) -> tuple[Any, ...]:
        """What the presenter takes."""
        return (self.result,)

    def _parts(self) -> Iterable[Part]:
        """Tables and sentences of the answer."""
        return self._presenter.parts(*self._shown)

    def _evidence(self) -> Iterable[Part]:
        """What the choices rest on, for ``--explain``."""
        return self._presenter.evidence(*self._shown)

    def _document(self) -> Mapping[str, Any]:
        """Everything but the time series; numbers that JSON does not have may be in it."""
        return self._presenter.document(*self._shown)

    def _page(self, command: str = "") -> Page:
        """A page to send; `command` repeats the answer."""
        return self._presenter.page(self._shown, self._drawn, self.warnings, command)

    @cached_property
    def _drawn(self) -> Sequence[Chart]:
        """The figures, the most important one first; made once for files, page and notebook."""
        return self._presenter.charts(*self._shown)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What one should know before trusting the numbers."""
        return getattr(self.result, "warnings", ())

    @property
    def document(self) -> Mapping[str, Any]:
        """Everything but the time series, as the command's ``--json`` has it."""
        return json.loads(to_json(self._document()))

    def summary(self) -> str:
        """The answer as text: what the command of the same name prints."""
        from flexid.report.terminal import as_text

        return as_text(self._parts())

    @entrance
    def plot(self, name: str = "", *, ax: Axes | None = None) -> Figure:
        """A figure that the command writes with ``--out``.

        Parameters
        ----------
        name : str, optional
            Of its file, without the suffix; the first one if not given.
        ax : Axes, optional
            In whose place the panels are drawn.
        """
        from flexid.report.figure import draw

        charts = {chart.name: chart for chart in self._drawn}
        name = name or next(iter(charts), "")
        if name not in charts:
            known = ", ".join(charts) or "none"
            raise SettingError("plot", f"there is no figure {name!r}; there is {known}")
        return draw(charts[name], ax=ax)

    @entrance
    def save(self, path: FilePath) -> None:
        """Write the document as JSON.

        Parameters
        ----------
        path : path
            The file; one that is there is replaced.
        """
        from flexid.files import write_document

        write_document(Path(path), to_json(self.document))

    @entrance
    def save_figures(self, directory: FilePath) -> None:
        """Write the figures that the command writes with ``--out``.

        Parameters
        ----------
        directory : path
            Where they go; made if it is not there.
        """
        from flexid.files import output_directory
        from flexid.report.figure import save_charts

        with output_directory(Path(directory)) as files:
            save_charts(self._drawn, files, self._formats)

    @entrance
    def report(self, path: FilePath) -> None:
        """Write a page to send: one HTML file with the answer, its tables and all figures.

        Figures of time series are left out where there are none, as in a loaded estimate.

        Parameters
        ----------
        path : path
            The file, such as ``"report.html"``; one that is there is replaced.
        """
        from flexid.files import write_document
        from flexid.report.page import page_html

        write_document(Path(path), page_html(self._page()))

    def _write_files(self, directory: Path, command: str, *, csv: bool) -> None:
        """Write what the command writes: document, time series, figures and page."""
        from flexid.report.figure import save_charts
        from flexid.report.page import NAME, page_html

        (directory / self._file).write_text(to_json(self._document()), encoding="utf-8")
        self._presenter.write_data(*self._shown, directory, csv)
        save_charts(self._drawn, directory, self._formats)
        (directory / NAME).write_text(page_html(self._page(command)), encoding="utf-8")

    def _repr_html_(self) -> str:
        from rich.console import Console

        from flexid.report.figure import draw, png
        from flexid.report.terminal import WIDEST, laid_out

        with io.StringIO() as nowhere:
            console = Console(record=True, file=nowhere, width=WIDEST, highlight=False)
            console.print(laid_out(self._parts(), WIDEST), crop=False)
            text = console.export_html(inline_styles=True, code_format="<pre>{code}</pre>")
        warnings = (f"<p>Warning: {escape(warning)}</p>" for warning in self.warnings)
        pictures = (base64.b64encode(png(draw(chart))).decode() for chart in self._drawn[:1])
        shown = (f'<img src="data:image/png;base64,{picture}"/>' for picture in pictures)
        return "".join((text, *warnings, *shown))


class EstimateAnswer(Answer):
    """An estimate, of a joint or of an arm."""

    _file = "estimate.json"

    def _document(self) -> Mapping[str, Any]:
        from flexid.stored_estimates.estimate_file import estimate_document

        return estimate_document(self.result)

    def supports(self, *, strict: bool = False) -> bool:
        """Whether the data determine every parameter, be it weakly.

        Parameters
        ----------
        strict : bool, optional
            Count what is weak as not determined.
        """
        return self.result.supports(strict=strict)
