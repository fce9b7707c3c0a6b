"""Base class of all results: text, notebook view, document, figures and files."""

from __future__ import annotations

import base64
import io
import json
from collections.abc import Mapping, Sequence
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
    from flexid.report.page import Page
    from flexid.report.terminal import Part

_OPTIONAL = ("answers", "charts", "evidence", "write_data")  # functions that a report may lack


class Answer:
    """Result of a flexid function: tables and a figure in a notebook, text in `summary`."""

    _report = ""  # module of `flexid.report` that presents the result
    _file = "result.json"  # name of the document among the files that the command writes
    _formats: tuple[str, ...] = ("png",)  # file formats of the figures

    def __init__(self, result: Any) -> None:
        self.result = result  # result object of the computation

    def __getattr__(self, name: str) -> Any:
        if not self._belongs_to_result(name):
            raise AttributeError(f"{type(self).__name__} has no {name!r}", name=name, obj=self)
        value = getattr(self.result, name)
        return MappingProxyType(value) if isinstance(value, dict) else value

    def __setattr__(self, name: str, value: Any) -> None:
        if self._belongs_to_result(name):
            raise AttributeError(f"the result's {name!r} is read-only", name=name, obj=self)
        super().__setattr__(name, value)

    def _belongs_to_result(self, name: str) -> bool:
        """Return whether the class declares the name as an attribute of the result."""
        every = (vars(each).get("__annotations__", ()) for each in type(self).__mro__)
        return name != "result" and not name.startswith("_") and any(name in one for one in every)

    @property
    def _shown(self) -> tuple[Any, ...]:
        """Arguments of the functions that present the result."""
        return (self.result,)

    def _present(self, function: str, *more: Any) -> Any:
        """Return what a function of the report's module gives; nothing if it need not have it."""
        module = import_module(f"flexid.report.{self._report}")
        if function in _OPTIONAL and not hasattr(module, function):
            return ()
        return getattr(module, function)(*self._shown, *more)

    def _parts(self, *, explain: bool = False) -> list[Part]:
        """Return tables and sentences of the result, and if requested the evidence for choices."""
        return [*self._present("parts"), *(self._present("evidence") if explain else ())]

    def _document(self) -> Mapping[str, Any]:
        """Return everything but the time series; numbers may be NaN or infinite."""
        return self._present("document")

    def _page(self, command: str = "") -> Page:
        """Return the report page; `command` is the command line that repeats the result."""
        from flexid.report.page import result_page

        provenance = self._document().get("provenance", {})
        return result_page(self._present, self._drawn, self.warnings, provenance, command)

    @cached_property
    def _drawn(self) -> Sequence[Chart]:
        """Figures, the most important first; made once for files, page and notebook."""
        return self._present("charts")

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings to read before the numbers are used."""
        return getattr(self.result, "warnings", ())

    @property
    def document(self) -> Mapping[str, Any]:
        """Everything but the time series, as the command's ``--json`` prints it."""
        return json.loads(to_json(self._document()))

    def summary(self) -> str:
        """Return the result as text, as the command of the same name prints it."""
        from flexid.report.terminal import as_text

        return as_text(self._parts())

    @entrance
    def plot(self, name: str = "", *, ax: Axes | None = None) -> Figure:
        """Draw a figure that the command writes with ``--out``.

        Parameters
        ----------
        name : str, optional
            Name of the figure's file without its suffix; the first figure if not given.
        ax : Axes, optional
            Axes that are replaced by the panels.
        """
        from flexid.report.figure import draw

        charts = {chart.name: chart for chart in self._drawn}
        name = name or next(iter(charts), "")
        if name not in charts:
            known = f"give one of {', '.join(charts)}" if charts else "this result has none"
            raise SettingError("plot", f"there is no figure {name!r}: {known}")
        return draw(charts[name], ax=ax)

    @entrance
    def save(self, path: FilePath) -> None:
        """Write the document as JSON.

        Parameters
        ----------
        path : path
            The file; an existing file is replaced.
        """
        from flexid.files import write_document

        write_document(Path(path), to_json(self.document))

    @entrance
    def save_figures(self, directory: FilePath) -> None:
        """Write the figures that the command writes with ``--out``.

        Parameters
        ----------
        directory : path
            Output directory; created if it does not exist.
        """
        from flexid.files import output_directory
        from flexid.report.figure import save_charts

        with output_directory(Path(directory)) as files:
            save_charts(self._drawn, files, self._formats)

    @entrance
    def report(self, path: FilePath) -> None:
        """Write the report page: one HTML file with the result, its tables and all figures.

        A result without time series, such as a loaded estimate, has no figures of them.

        Parameters
        ----------
        path : path
            The file, such as ``"report.html"``; an existing file is replaced.
        """
        from flexid.files import write_document
        from flexid.report.page import page_html

        write_document(Path(path), page_html(self._page()))

    def _write_files(self, directory: Path, command: str, *, csv: bool) -> None:
        """Write the files of the command: document, time series, figures and page."""
        from flexid.report.figure import save_charts
        from flexid.report.page import NAME, page_html

        (directory / self._file).write_text(to_json(self._document()), encoding="utf-8")
        self._present("write_data", directory, csv)
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
    """Values of a joint or of an arm, each with a verdict."""

    _file = "estimate.json"

    def supports(self, *, strict: bool = False) -> bool:
        """Return whether the data determine every parameter, at least weakly.

        Parameters of unusual terms count only if a setting asks for the term.

        Parameters
        ----------
        strict : bool, optional
            Count weak parameters as not determined.
        """
        return self.result.supports(strict=strict)
