"""The paper, run and checked: `flexid.reproduce`."""

from typing import TYPE_CHECKING

from flexid.identification.vocabulary.progress import Progress, silent
from flexid.library.answer import ReportedAnswer
from flexid.library.entrance import entrance, in_one_thread

if TYPE_CHECKING:
    from flexid.studies.huang2003.evidence import Claim
    from flexid.studies.huang2003.reproduction import Reproduction


class PaperReproduction(ReportedAnswer):
    """Huang (2003) reproduced: Table I, Figures 1 to 5, the readings, every claim.

    Parameters
    ----------
    result : Reproduction
        All runs, and what they amount to.
    """

    _report = "reproduction"
    _formats = ("png", "pdf")

    def __init__(self, result: "Reproduction") -> None:
        self.result = result

    @property
    def claims(self) -> "tuple[Claim, ...]":
        """The paper's claims, decided."""
        return self.result.claims

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
