"""What is found of an arm of several elastic joints."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexid.identification.vocabulary.progress import Progress, silent
from flexid.library.answer import ReportedAnswer
from flexid.library.threads import in_one_thread

if TYPE_CHECKING:
    from flexid.arms.result import ArmIdentification
    from flexid.report.page.layout import Page
    from flexid.report.terminal import Part


class ArmEstimate(ReportedAnswer):
    """Parameters of each joint of an arm, with intervals and verdicts."""

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

    def _document(self) -> Mapping[str, Any]:
        result = self.result
        return {
            "kind": "planar arm",
            "arm": result.arm,
            "joints": [
                {p.name: p for p in result.of_joint(joint)}
                for joint in range(1, result.arm.joints + 1)
            ],
            "fit": {
                "names": result.names,
                "covariance": result.covariance,
                "fixed": result.fixed,
            },
            "free_run_percent": result.free_run,
            "residual_excess": result.residual_excess,
            "hold": result.hold,
            "input_delay": result.input_delay,
            "segment_duration": result.segment_duration,
            "condition_number": result.condition_number,
            "warnings": result.warnings,
            "provenance": result.provenance,
        }

    def _parts(self) -> "Iterable[Part]":
        from flexid.report.arm_table import arm_parts

        return arm_parts(self.result)

    def _page(self, command: str = "", out: str = "") -> "Page":  # noqa: ARG002
        from flexid.report.page.arm_page import arm_page

        return arm_page(self.result, command)


@in_one_thread
def identify_arm(
    log: Path, arm: Path, columns: Path | None = None, progress: Progress = silent
) -> ArmEstimate:
    """Parameters of the arm that a TOML file describes, from one log."""
    from flexid.arms.identify import identify_arm as run
    from flexid.models.arm_file import read_arm

    return ArmEstimate(run(log, read_arm(arm), columns, progress))
