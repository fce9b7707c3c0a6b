"""The paper, run and checked: `flexid.reproduce`."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from flexid.identification.vocabulary.progress import Progress, silent
from flexid.library.answer import ReportedAnswer
from flexid.library.entrance import entrance
from flexid.library.threads import in_one_thread

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from flexid.report.charts.description import Chart
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

    _formats = ("png", "pdf")

    def __init__(self, result: "Reproduction") -> None:
        self.result = result

    @property
    def claims(self) -> "tuple[Claim, ...]":
        """The paper's claims, decided."""
        return self.result.claims

    def _document(self) -> Mapping[str, Any]:
        from flexid.report.huang2003_document import reproduction_document

        return reproduction_document(self.result)

    def _charts(self) -> "Sequence[Chart]":
        from flexid.report.huang2003_charts import reproduction_charts

        return reproduction_charts(self.result)

    def _parts(self) -> "Iterable[Part]":
        from flexid.report.huang2003_table import reproduction_parts

        return reproduction_parts(self.result)

    def _page(self, command: str = "", out: str = "") -> "Page":  # noqa: ARG002
        from flexid.report.page.reproduction_page import reproduction_page

        return reproduction_page(self.result, self._drawn)

    def __repr__(self) -> str:
        verdicts = [claim.verdict for claim in self.claims]
        return f"<PaperReproduction: {verdicts.count('holds')} of {len(verdicts)} claims hold>"


@entrance
@in_one_thread
def reproduce(*, progress: Progress = silent) -> PaperReproduction:
    """Reproduce the paper, and check its claims.

    Huang (2003): Table I, Figures 1 to 5, both readings of its control law, and every claim.

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
