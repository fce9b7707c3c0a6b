"""The paper, run and checked: `flexid.reproduce`."""

from collections.abc import Mapping
from os import PathLike
from typing import TYPE_CHECKING, Any

from flexid.identification.vocabulary.progress import Progress, silent
from flexid.library.answer import ReportedAnswer
from flexid.library.checks import as_path
from flexid.library.entrance import entrance
from flexid.library.threads import in_one_thread

if TYPE_CHECKING:
    from collections.abc import Iterable

    from flexid.report.page.layout import Page
    from flexid.report.terminal import Part
    from flexid.studies.huang2003.evidence import Claim
    from flexid.studies.huang2003.reproduction import Reproduction


class PaperReproduction(ReportedAnswer):
    """Huang (2003) reproduced: Table I, Figures 1 to 5, the readings, every claim.

    Parameters
    ----------
    result : Reproduction
        All runs, and what they amount to.
    """

    def __init__(self, result: "Reproduction") -> None:
        self.result = result

    @property
    def claims(self) -> "tuple[Claim, ...]":
        """The paper's claims, decided."""
        return self.result.claims

    def _document(self) -> Mapping[str, Any]:
        from flexid.report.huang2003_document import reproduction_document

        return reproduction_document(self.result)

    def save_figures(self, directory: "str | PathLike[str]") -> None:
        """Write the figures that ``flexid reproduce --out`` writes.

        Parameters
        ----------
        directory : path
            Where they go; made if it is not there.

        Raises
        ------
        SettingError
            If it cannot be written.
        """
        from flexid.report.charts.figure import save_charts
        from flexid.report.documents import output_directory
        from flexid.report.huang2003_charts import FORMATS, reproduction_charts

        with output_directory(as_path("save_figures", "directory", directory)) as files:
            save_charts(reproduction_charts(self.result), files, FORMATS)

    def _parts(self) -> "Iterable[Part]":
        from flexid.report.huang2003_table import reproduction_parts

        return reproduction_parts(self.result)

    def _page(self) -> "Page":
        from flexid.report.huang2003_charts import reproduction_charts
        from flexid.report.page.reproduction_page import reproduction_page

        return reproduction_page(self.result, reproduction_charts(self.result))

    def __repr__(self) -> str:
        verdicts = [claim.verdict for claim in self.claims]
        return f"<PaperReproduction: {verdicts.count('holds')} of {len(verdicts)} claims hold>"


@entrance
@in_one_thread
def reproduce(*, progress: Progress = silent) -> PaperReproduction:
    """Reproduce Huang (2003): Table I, Figures 1 to 5, the readings, every claim.

    Parameters
    ----------
    progress : callable, optional
        Called with the name of each part that is done.

    Returns
    -------
    PaperReproduction
        All runs, and every claim decided.

    Raises
    ------
    ArgumentError
        If an option is unknown.
    """
    from flexid.studies.huang2003.reproduction import reproduce as run

    return PaperReproduction(run(progress))
