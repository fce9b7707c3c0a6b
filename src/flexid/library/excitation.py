"""Assessment of a log, and design of a motion: `flexid.excitation` and `flexid.design`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexid.errors import SettingError
from flexid.identification.vocabulary import Progress, silent
from flexid.library.answer import Answer, EstimateAnswer
from flexid.library.arguments import entrance, joint_settings, one_thread, options_of
from flexid.library.identify import estimated, identify

if TYPE_CHECKING:
    from flexid.experiment_design.design import Design
    from flexid.experiment_design.excitation_report import (
        Advice,
        CoefficientAssessment,
        ExcitationReport,
    )
    from flexid.library.arguments import FilePath
    from flexid.library.joint_estimate import JointEstimate
    from flexid.library.logs import Columns, Logs


class LogExcitation(EstimateAnswer):
    """How well a log determines each coefficient, and what its motion lacks."""

    _report = "excitation"
    _file = "excitation.json"

    result: ExcitationReport
    coefficients: Mapping[str, CoefficientAssessment]
    """By name: value, interval, verdict, and the unknown that correlates most with the value."""
    advice: Advice | None
    """Advice for the next motion; None if every coefficient is determined."""

    @property
    def estimate(self) -> JointEstimate:
        """Estimate that `flexid.identify` returns for the log."""
        from flexid.library.joint_estimate import JointEstimate

        return JointEstimate(self.result.identification)

    def __repr__(self) -> str:
        found = [c.verdict for c in self.coefficients.values()]
        determined = f"{found.count('determined')} of {len(found)} coefficients determined"
        return f"<LogExcitation: {determined}>"


@entrance
@one_thread()
@options_of(identify, "stream", "thresholds")
def excitation(
    logs: Logs,
    *,
    columns: Columns | None = None,
    progress: Progress = silent,
    **options: Any,
) -> LogExcitation:
    """Assess what a log determines, and what its motion lacks.

    The log is identified as by flexid identify, with the same options and results. The report adds
    the unknown that correlates most with each coefficient, and advice for the next motion.

    Parameters
    ----------
    logs : log or list of logs
        Logs of one drive. As `flexid.identify` takes them.
    """
    from flexid.experiment_design.excitation_report import examine
    from flexid.library.logs import all_logs

    read = all_logs(logs, columns)
    return LogExcitation(examine(read, joint_settings(**options), progress))


class ExperimentDesign(Answer):
    """Motion that determines the coefficients within the drive's limits, with predictions."""

    _report = "design"
    _file = "design.json"

    result: Design
    supported: bool
    """Whether every coefficient would be determined to 10 % or better."""

    @property
    def deviations(self) -> Mapping[str, float]:
        """Predicted standard deviation of each coefficient, divided by its value."""
        return self.result.prediction.deviations

    def __repr__(self) -> str:
        wanted = self.result.drive.experiment
        worst = 100 * self.result.prediction.worst
        return f"<ExperimentDesign: {wanted.duration:g} s, worst coefficient within {worst:.2g} %>"


@entrance
@one_thread()
def design(
    drive: FilePath,
    *,
    duration: float | None = None,
    estimate: JointEstimate | FilePath | Mapping[str, Any] | None = None,
    seed: int = 0,
    progress: Progress = silent,
) -> ExperimentDesign:
    """Design a motion that determines the parameters.

    The motion respects the drive's limits, even if the assumed parameters are wrong by 30 %.

    Parameters
    ----------
    drive : path
        A TOML file with parameters, limits and sensors of the drive.
    duration : float, optional
        Duration of the experiment in s; by default the duration in the file.
    estimate : JointEstimate or path, optional
        An estimate.json of flexid identify, whose values replace the file's parameters. Or the
        result of `flexid.identify`.
    seed : int, optional
        Seed of the search's random starts.
    progress : callable, optional
        Called with the name of each completed step.
    """
    from flexid.experiment_design.design import design as run
    from flexid.experiment_design.drive import read_drive

    if seed < 0:
        raise SettingError("seed", f"must be 0 or more, got {seed}")
    choices = {} if duration is None else {"duration": duration}
    earlier = None if estimate is None else estimated(estimate)
    return ExperimentDesign(run(read_drive(Path(drive), earlier, choices), seed, progress))
