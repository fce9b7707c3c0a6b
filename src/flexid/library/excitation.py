"""What a log can say, and what to add: `flexid.excitation`."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from flexid.identification.vocabulary.progress import Progress, silent
from flexid.library.answer import Answer, html_figure
from flexid.library.entrance import entrance
from flexid.library.joint_estimate import JointEstimate
from flexid.library.logs import all_logs
from flexid.library.options import joint_settings
from flexid.library.threads import in_one_thread

if TYPE_CHECKING:
    from collections.abc import Iterable

    from matplotlib.figure import Figure

    from flexid.experiment_design.advice import Advice
    from flexid.experiment_design.assessment import CoefficientAssessment
    from flexid.experiment_design.excitation_report import ExcitationReport
    from flexid.library.logs import Columns, Logs
    from flexid.library.options import AutoHold, AutoModel, AutoNumber, Bounds, Known, Terms
    from flexid.report.terminal import Part


class LogExcitation(Answer):
    """How well a log determines each coefficient, what confuses it, and what to add.

    Parameters
    ----------
    result : ExcitationReport
        What was found.
    """

    def __init__(self, result: "ExcitationReport") -> None:
        self.result = result

    @property
    def estimate(self) -> JointEstimate:
        """What `flexid.identify` finds in the log."""
        return JointEstimate(self.result.identification)

    @property
    def coefficients(self) -> "Mapping[str, CoefficientAssessment]":
        """By name: value, interval, verdict, and the coefficient that each is confused with."""
        return self.result.assessment.coefficients

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
        return self.estimate.supports(strict=strict)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What one should know before trusting the numbers."""
        return self.result.identification.warnings

    def _document(self) -> Mapping[str, Any]:
        from flexid.report.design_documents import excitation_document

        return excitation_document(self.result)

    def plot(self) -> "Figure":
        """Widths of the intervals, and the tones of the input."""
        from flexid.report.charts.figure import draw
        from flexid.report.excitation_report_chart import excitation_report_chart

        return draw(excitation_report_chart(self.result))

    def _parts(self) -> "Iterable[Part]":
        from flexid.report.excitation_table import excitation_parts

        return excitation_parts(self.result)

    def __repr__(self) -> str:
        found = [c.verdict for c in self.coefficients.values()]
        determined = f"{found.count('determined')} of {len(found)} coefficients determined"
        return f"<LogExcitation: {determined}>"

    def _repr_html_(self) -> str:
        return super()._repr_html_() + html_figure(self.plot())


@entrance
@in_one_thread
def excitation(
    logs: "Logs",
    *,
    columns: "Columns | None" = None,
    known: "Known | None" = None,
    bounds: "Bounds | None" = None,
    model: "AutoModel" = "auto",
    terms: "Terms" = "auto",
    hold: "AutoHold" = "auto",
    input_delay: "AutoNumber" = "auto",
    link_delay: "AutoNumber" = "auto",
    coulomb_velocity: "AutoNumber" = "auto",
    filter_rate: "AutoNumber" = "auto",
    segment_duration: "AutoNumber" = "auto",
    validation_share: float = 1 / 3,
    progress: Progress = silent,
) -> LogExcitation:
    """Say how well a log determines each coefficient, which are confounded, and what to add.

    The log is identified as `flexid.identify` does it, with the same answers.

    Parameters
    ----------
    logs : log or list of logs
        Of one drive, as `flexid.identify` takes them.
    columns : path or mapping, optional
        A column map, which renames, scales and combines raw columns: a TOML file, or what it would
        hold, such as ``{"motor_position": {"column": "pot_V", "scale": 35.32, "unit": "deg"}}``.
    known : mapping of str to float or (float, float), optional
        Physical parameters or coefficients that are known, with their standard deviation if they
        have one.
    bounds : mapping of str to (float, float), optional
        Lower and upper end of physical parameters or coefficients, None where there is none.
    model : {"auto", "flexible", "link", "rigid"}, optional
        Of the joint: flexible; the link alone, driven by the measured motor position, without the
        input; or rigid, from the motor's encoder alone. What the log shows, if not given.
    terms : iterable of str, optional
        Terms of the model beside the joint spring: see `flexid.TERMS`.
    hold : {"auto", "zero", "linear", "cubic"}, optional
        The input between samples: held, on straight lines, or smooth.
    input_delay : float, optional
        Seconds by which the input acts later than recorded.
    link_delay : float, optional
        Seconds by which the link's encoder lags behind the motor's.
    coulomb_velocity : float, optional
        Velocity in rad/s over which Coulomb friction changes sign; ``"auto"``: at once.
    filter_rate : float, optional
        Rate in 1/s of the filter of least squares.
    segment_duration : float, optional
        Length in s of the segments of the prediction error.
    validation_share : float, optional
        Share of each log, at its end, that is kept out of the fit and predicted.
    progress : callable, optional
        Called with each step in words, for example ``print``.

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

    settings = joint_settings(
        "excitation",
        known=known,
        bounds=bounds,
        model=model,
        terms=terms,
        hold=hold,
        input_delay=input_delay,
        link_delay=link_delay,
        coulomb_velocity=coulomb_velocity,
        filter_rate=filter_rate,
        segment_duration=segment_duration,
        validation_share=validation_share,
    )
    return LogExcitation(examine(all_logs("excitation", logs, columns), settings, progress))
