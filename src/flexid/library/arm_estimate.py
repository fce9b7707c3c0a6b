"""What is found of an arm of several elastic joints."""

from pathlib import Path
from typing import TYPE_CHECKING

from flexid.identification.vocabulary.progress import Progress, silent
from flexid.library.answer import ReportedAnswer
from flexid.library.entrance import in_one_thread

if TYPE_CHECKING:
    from flexid.arms.result import ArmIdentification


class ArmEstimate(ReportedAnswer):
    """Parameters of each joint of an arm, with intervals and verdicts."""

    _report = "arm"
    _file = "estimate.json"

    def __init__(self, result: "ArmIdentification") -> None:
        self.result = result

    def supports(self, *, strict: bool = False) -> bool:
        """Whether every parameter is determined or weak; if strict, determined."""
        return self.result.supports(strict=strict)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What one should know before trusting the numbers."""
        return self.result.warnings


@in_one_thread
def identify_arm(
    log: Path, arm: Path, columns: Path | None = None, progress: Progress = silent
) -> ArmEstimate:
    """Parameters of the arm that a TOML file describes, from one log."""
    from flexid.arms.identify import identify_arm as run
    from flexid.models.arm_file import read_arm

    return ArmEstimate(run(log, read_arm(arm), columns, progress))
