"""What a log can say, and what to add: `flexid.excitation`."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Unpack

from flexid.identification.vocabulary.progress import Progress, silent
from flexid.library.answer import PlottedAnswer
from flexid.library.entrance import entrance, in_one_thread, options_of
from flexid.library.identify import identify
from flexid.library.options import joint_settings

if TYPE_CHECKING:
    from flexid.experiment_design.advice import Advice
    from flexid.experiment_design.excitation_report import CoefficientAssessment, ExcitationReport
    from flexid.library.joint_estimate import JointEstimate
    from flexid.library.logs import Columns, Logs
    from flexid.library.options import JointOptions


class LogExcitation(PlottedAnswer):
    """How well a log determines each coefficient, what confuses it, and what to add.

    Parameters
    ----------
    result : ExcitationReport
        What was found.
    """

    _report = "excitation"
    _file = "excitation.json"

    def __init__(self, result: "ExcitationReport") -> None:
        self.result = result

    @property
    def estimate(self) -> "JointEstimate":
        """What `flexid.identify` finds in the log."""
        from flexid.library.joint_estimate import JointEstimate

        return JointEstimate(self.result.identification)

    @property
    def coefficients(self) -> "Mapping[str, CoefficientAssessment]":
        """By name: value, interval, verdict, and the coefficient that each is confused with."""
        return self.result.coefficients

    @property
    def advice(self) -> "Advice | None":
        """What to add to the input; None where every coefficient is determined."""
        return self.result.advice

    def supports(self, *, strict: bool = False) -> bool:
        """Whether the data determine every parameter, be it weakly.

        Parameters
        ----------
        strict : bool, optional
            Count what is weak as not determined.
        """
        return self.result.identification.supports(strict=strict)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What one should know before trusting the numbers."""
        return self.result.identification.warnings

    def __repr__(self) -> str:
        found = [c.verdict for c in self.coefficients.values()]
        determined = f"{found.count('determined')} of {len(found)} coefficients determined"
        return f"<LogExcitation: {determined}>"


@entrance
@in_one_thread
@options_of(identify, "stream", "thresholds")
def excitation(
    logs: "Logs",
    *,
    columns: "Columns | None" = None,
    progress: Progress = silent,
    **options: "Unpack[JointOptions]",
) -> LogExcitation:
    """Say what a log determines, and what motion to add.

    The log is identified as flexid identify does it, with the same options and the same answers.
    Added is what each coefficient is confused with, and which sine would help.

    Parameters
    ----------
    logs : log or list of logs
        Logs of one drive. As `flexid.identify` takes them.

    Returns
    -------
    LogExcitation
        Coefficients with what confuses them, and advice on what to add.

    Raises
    ------
    RecordingError
        If a log cannot be used, or the logs do not go together.
    SettingError
        If a value of an option cannot be used.
    ConvergenceError
        If the model cannot be fitted from any start.
    ArgumentError
        If an option is unknown or of a wrong type.
    """
    from flexid.experiment_design.excitation_report import examine
    from flexid.library.logs import all_logs

    settings = joint_settings("excitation", **options)
    return LogExcitation(examine(all_logs("excitation", logs, columns), settings, progress))
