"""What the studio's processes do: look at a log, check it, identify it, export what was found.

Each is a function of plain arguments and results, which travel between processes. A log is named
relative to the working directory, so that no message and no file names a folder of the studio.
"""

from __future__ import annotations

import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, get_args

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexid.identification.vocabulary.progress import Progress
    from flexid.recording.overview import FileOverview
    from flexid.recording.survey import LogSurvey
    from flexid.report.charts.svg import Drawn
    from flexid.report.page.page import Answer as PageAnswer
    from flexid.report.terminal import Table
    from flexid.studio.choices import Choices

ESTIMATE = "estimate.json"
REPORT = "report.html"


@dataclass(frozen=True)
class Checked:
    """A log, read and looked at."""

    survey: LogSurvey  # what it shows at a glance
    warnings: tuple[str, ...]  # what was mended, or looks odd
    origins: dict[str, str]  # the columns of each channel
    figure: Drawn  # its channels over time
    kinds_of: dict[str, str]  # by term, the kinds of joint that have it


@dataclass(frozen=True)
class Answer:
    """What an identification found, for the page."""

    answers: Sequence[PageAnswer]  # to what one asks first, as the report has them
    parameters: Table
    coefficients: Table
    reasons: dict[str, str]  # why something is not determined, by name
    summary: tuple[str, ...]  # sentences
    warnings: tuple[str, ...]  # sentences
    terms: tuple[str, ...]  # terms of the model
    hold: str  # the input between samples
    figures: tuple[Drawn, ...]  # what the report has too
    sample_time: float  # of the log, in s


def look(_: Progress, name: str) -> FileOverview:
    """Say what a file holds."""
    from flexid.recording.overview import overview

    return overview(Path(name))


def check(_: Progress, name: str, choices: Choices) -> Checked:
    """Read a log as it would be identified, and say what it shows."""
    from flexid.identification.preparation.joint import Kind, joint_of
    from flexid.recording.read import read_log
    from flexid.recording.survey import survey
    from flexid.report.charts.svg import drawn
    from flexid.report.free_run_chart import log_chart
    from flexid.studio.choices import ALL_TERMS

    log = read_log(Path(name), choices.column_map)
    kinds_of = {
        term: " ".join(kind for kind in get_args(Kind) if term in joint_of(kind).terms)
        for term in ALL_TERMS
    }
    origins = {channel: " + ".join(origin.columns) for channel, origin in log.columns.items()}
    return Checked(survey(log), log.warnings, origins, drawn(log_chart(log)), kinds_of)


def identify(progress: Progress, name: str, choices: Choices, into: str) -> Answer:
    """Identify a log, and leave estimate and report in a folder."""
    from flexid.library.identify import identify as run
    from flexid.recording.read import read_log
    from flexid.report.charts.svg import drawn
    from flexid.report.documents import write_document
    from flexid.report.identification import coefficients_table, parameters_table
    from flexid.report.identification_charts import identification_charts
    from flexid.report.page.identification_page import identification_page
    from flexid.report.page.page import page_html

    progress("reading the log (the first run on a machine compiles for up to a minute)")
    log = read_log(Path(name), choices.column_map)
    estimate = run(log, **choices.settings, progress=progress)
    progress("report and figures")
    estimate.save(Path(into) / ESTIMATE)
    result = estimate.result
    estimates = {**result.parameters, **result.coefficients}
    charts = identification_charts(result)
    page = identification_page(result, charts)
    write_document(Path(into) / REPORT, page_html(page))
    return Answer(
        page.answers,
        parameters_table(result),
        coefficients_table(result),
        {name: e.reason for name, e in estimates.items() if e.interval[0] != e.interval[1]},
        result.summary,
        result.warnings,
        result.choices.terms,
        result.choices.hold,
        tuple(map(drawn, charts)),
        log.recordings[0].sample_time,
    )


def export(_: Progress, to: str, sample_time: float, folder: str) -> str:
    """Write an estimate for another tool, as an archive; return the archive's name."""
    import tempfile

    from flexid.library.export import export as write

    place = Path(folder)
    options = {"sample_time": sample_time} if to in ("c99", "fmu") else {}
    with tempfile.TemporaryDirectory(dir=place) as made:
        written = write(place / ESTIMATE, to=to, out=made, **options)  # type: ignore[arg-type]
        archive = place / f"{to}.zip"
        with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as file:
            for path in written.paths:
                file.write(path, path.name)
    return archive.name
