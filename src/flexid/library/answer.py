"""What all answers have in common: text, a page of a notebook, a document, figures, files."""

import base64
import html
import io
import json
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexid.library.checks import as_path

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from flexid.report.charts.description import Chart
    from flexid.report.page.layout import Page
    from flexid.report.terminal import Part

_WIDTH = 100  # columns of a text


class Answer(ABC):
    """What a function of flexid returns.

    In a notebook it shows itself as tables and a figure; `print` of its `summary` is what the
    command of the same name prints.
    """

    _file = "result.json"  # among what the command writes
    _formats: tuple[str, ...] = ("png",)  # of the figures

    @abstractmethod
    def _parts(self) -> "Iterable[Part]":
        """Tables and sentences of the answer."""

    def _evidence(self) -> "Iterable[Part]":
        """What the choices rest on, for ``--explain``."""
        return ()

    @abstractmethod
    def _document(self) -> Mapping[str, Any]:
        """Everything but the time series; numbers that JSON does not have may be in it."""

    def _charts(self) -> "Sequence[Chart]":
        """Figures, the most important one first."""
        return ()

    @cached_property
    def _drawn(self) -> "Sequence[Chart]":
        """The figures, made once for files, page and notebook."""
        return self._charts()

    def _write_data(self, directory: Path, *, csv: bool) -> None:  # noqa: B027 - most have none
        """Write the time series of the answer."""

    @property
    def warnings(self) -> tuple[str, ...]:
        """What one should know before trusting the numbers."""
        return ()

    @property
    def document(self) -> Mapping[str, Any]:
        """Everything but the time series, as the command's ``--json`` has it."""
        from flexid.report.documents import to_json

        return json.loads(to_json(self._document()))

    def summary(self) -> str:
        """The answer as text: what the command of the same name prints."""
        return as_text(self._parts())

    def save(self, path: "str | PathLike[str]") -> None:
        """Write the document as JSON.

        Parameters
        ----------
        path : path
            The file; one that is there is replaced.

        Raises
        ------
        SettingError
            If it cannot be written.
        """
        from flexid.report.documents import to_json, write_document

        write_document(as_path("save", "path", path), to_json(self.document))

    def save_figures(self, directory: "str | PathLike[str]") -> None:
        """Write the figures that the command writes with ``--out``.

        Parameters
        ----------
        directory : path
            Where they go; made if it is not there.

        Raises
        ------
        SettingError
            If it cannot be written, or the answer was loaded and has no time series.
        """
        from flexid.report.charts.figure import save_charts
        from flexid.report.documents import output_directory

        with output_directory(as_path("save_figures", "directory", directory)) as files:
            save_charts(self._drawn, files, self._formats)

    def _page(self, command: str = "", out: str = "") -> "Page | None":  # noqa: ARG002
        """A page to send; `command` repeats the answer, whose files are in `out`."""
        return None

    def _write_files(self, directory: Path, command: str, out: str, *, csv: bool) -> None:
        """Write what the command writes: document, time series, figures and page."""
        from flexid.report.charts.figure import save_charts
        from flexid.report.documents import to_json
        from flexid.report.page.render import save_page

        (directory / self._file).write_text(to_json(self._document()), encoding="utf-8")
        self._write_data(directory, csv=csv)
        save_charts(self._drawn, directory, self._formats)
        page = self._page(command, out)
        if page is not None:
            save_page(page, directory)

    def _repr_html_(self) -> str:
        from flexid.report.charts.figure import draw

        text = f"<pre>{html.escape(self.summary())}</pre>"
        warnings = (html_paragraph(f"Warning: {warning}") for warning in self.warnings)
        figures = (html_figure(draw(chart)) for chart in self._drawn[:1])
        return "".join((text, *warnings, *figures))


class ReportedAnswer(Answer):
    """An answer that has a page to send."""

    @abstractmethod
    def _page(self, command: str = "", out: str = "") -> "Page":
        """The page to send."""

    def report(self, path: "str | PathLike[str]") -> None:
        """Write a page to send: one HTML file with the answer, its tables and all figures.

        Figures of time series are left out where there are none, as in a loaded estimate.

        Parameters
        ----------
        path : path
            The file, such as ``"report.html"``; one that is there is replaced.

        Raises
        ------
        SettingError
            If it cannot be written.
        """
        from flexid.report.documents import write_document
        from flexid.report.page.render import page_html

        write_document(as_path("report", "path", path), page_html(self._page()))


def as_text(parts: "Iterable[Part]") -> str:
    """Tables and sentences as lines of text, without colour."""
    from flexid.report.terminal import laid_out

    return "\n".join(line.plain for line in laid_out(parts, _WIDTH))


def html_table(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table for a notebook; a cell may be HTML already if it begins with ``<``."""

    def cell(text: str) -> str:
        return f"<td>{text if text.startswith('<span') else html.escape(text)}</td>"

    head = "".join(f"<th>{html.escape(heading)}</th>" for heading in headings)
    body = "".join(f"<tr>{''.join(map(cell, row))}</tr>" for row in rows)
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def html_paragraph(text: str) -> str:
    """A sentence of a page."""
    return f"<p>{html.escape(text)}</p>"


def html_figure(figure: "Figure") -> str:
    """A figure within a page."""
    with io.BytesIO() as file:
        figure.savefig(file, format="png", dpi=figure.dpi)
        encoded = base64.b64encode(file.getvalue()).decode()
    return f'<img src="data:image/png;base64,{encoded}"/>'


def data_frame(columns: Mapping[str, Any], backend: str) -> Any:
    """A data frame of a library; a `SettingError` if that library is not installed."""
    import narwhals as nw

    from flexid.errors import SettingError

    known = ("polars", "pandas", "pyarrow")
    if backend not in known:
        raise SettingError("backend", f"must be one of {', '.join(known)}, got {backend!r}")
    try:
        return nw.from_dict(columns, backend=backend).to_native()  # type: ignore[arg-type]
    except ImportError:
        raise SettingError("backend", f"{backend} is not installed: install it") from None
