"""An input that determines the coefficients: `flexid.design`."""

from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from flexid.errors import ArgumentError, SettingError
from flexid.identification.vocabulary.progress import Progress, silent
from flexid.library.answer import Answer, data_frame
from flexid.library.checks import as_path, kind_of
from flexid.library.entrance import entrance
from flexid.library.estimates import estimate_content
from flexid.library.options import as_number
from flexid.library.threads import in_one_thread

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from flexid.experiment_design.result import Design
    from flexid.library.joint_estimate import JointEstimate
    from flexid.report.charts.description import Chart
    from flexid.report.terminal import Part


class ExperimentDesign(Answer):
    """An experiment that determines the coefficients within limits, with its predictions.

    Parameters
    ----------
    result : Design
        What was found.
    warnings : tuple of str, optional
        Parts of an estimate that the design does not use, or that are uncertain.
    """

    _file = "design.json"

    def __init__(self, result: "Design", warnings: tuple[str, ...] = ()) -> None:
        self.result = result
        self._warnings = warnings

    @property
    def warnings(self) -> tuple[str, ...]:
        """Parts of an estimate that the design does not use, or that are uncertain."""
        return self._warnings

    @property
    def deviations(self) -> Mapping[str, float]:
        """Predicted standard deviation of each coefficient over its value."""
        return self.result.prediction.deviations

    @property
    def supported(self) -> bool:
        """Whether every coefficient would be determined to 10 % or better."""
        return self.result.supported

    def _document(self) -> Mapping[str, Any]:
        import numpy as np

        result = self.result
        cosines, sines = np.split(result.weights, 2)
        return {
            "drive": result.drive.document(),
            "coefficients": result.drive.coefficients,
            "tones": {
                "angular_frequencies": result.angular_frequencies,
                "cosines": cosines,
                "sines": sines,
            },
            "position_loop_gains": result.command.gains,
            "prediction": result.prediction,
            "references": result.references,
            "references_within_limits": result.kept_references,
            "largest_use": result.largest_use,
            "largest_deviations": result.largest_deviations,
            "scale": result.scale,
            "supported": result.supported,
            "seed": result.seed,
            "provenance": result.provenance,
        }

    def to_dataframe(self, backend: str = "polars") -> Any:
        """What a drive can play, as a data frame: the columns of ``command.csv``.

        Parameters
        ----------
        backend : {"polars", "pandas", "pyarrow"}, optional
            Whose data frame; the library has to be installed.
        """
        from flexid.report.design_files import command_columns

        return data_frame(command_columns(self.result), backend)

    def plot(self, ax: "Axes | None" = None) -> "Figure":
        """The torque, the motion that it makes, its tones, and what they would determine.

        Parameters
        ----------
        ax : Axes, optional
            In whose place the panels are drawn.
        """
        from flexid.report.charts.figure import draw

        return draw(self._drawn[0], ax=ax)

    def _charts(self) -> "Sequence[Chart]":
        from flexid.report.design_chart import design_chart

        return (design_chart(self.result),)

    def _write_data(self, directory: Path, *, csv: bool) -> None:  # noqa: ARG002
        from flexid.report.design_files import save_command

        save_command(self.result, directory)

    def _parts(self) -> "Iterable[Part]":
        from flexid.report.design_table import design_parts

        return design_parts(self.result)

    def __repr__(self) -> str:
        wanted = self.result.drive.experiment
        worst = 100 * self.result.prediction.worst
        return (
            f"<ExperimentDesign: {wanted.kind} of {wanted.duration:g} s, "
            f"worst coefficient within {worst:.2g} %>"
        )


@entrance
@in_one_thread
def design(
    drive: "str | PathLike[str]",
    *,
    kind: Literal["multisine", "trajectory"] | None = None,
    criterion: Literal["E", "D"] | None = None,
    duration: float | None = None,
    estimate: "JointEstimate | str | PathLike[str] | None" = None,
    seed: int = 0,
    progress: Progress = silent,
) -> ExperimentDesign:
    """Design a motion that determines the parameters.

    It keeps to the drive's limits, and is checked on drives that are wrong by 30 %.

    Parameters
    ----------
    drive : path
        A TOML file with parameters, limits and sensors of the drive.
    kind : {"multisine", "trajectory"}, optional
        A torque to play, or a motor position to follow; as the file says if not given.
    criterion : {"E", "D"}, optional
        Make the worst direction small, or the volume; as the file says if not given.
    duration : float, optional
        Seconds that the experiment lasts; as the file says if not given.
    estimate : JointEstimate or path, optional
        An estimate.json of flexid identify, whose values replace the file's parameters. Or what
        `flexid.identify` returned.
    seed : int, optional
        Seed of the search's random starts.
    progress : callable, optional
        Called with the name of each step that is done.

    Returns
    -------
    ExperimentDesign
        The experiment, what it would determine, and how close it comes to the limits.

    Raises
    ------
    SettingError
        If a file cannot be used, or the limits leave no motion.
    ArgumentError
        If an option is unknown or of a wrong type.
    """
    from flexid.experiment_design.design import design as run
    from flexid.experiment_design.drive_file import read_drive

    if isinstance(seed, bool) or not isinstance(seed, int):
        raise ArgumentError("design", "seed", f"is {kind_of(seed)}: give a whole number")
    if seed < 0:
        raise SettingError("seed", "give a whole number, 0 or more")
    given = {"kind": kind, "criterion": criterion}
    for name, value in given.items():
        if value is not None and not isinstance(value, str):
            raise ArgumentError("design", name, f"is {kind_of(value)}: give a name")
    choices: dict[str, Any] = {name: value for name, value in given.items() if value is not None}
    if duration is not None:
        choices["duration"] = as_number("design", "duration", duration)
    earlier = None if estimate is None else estimate_content("design", "estimate", estimate)
    file = read_drive(as_path("design", "drive", drive), earlier, choices)
    return ExperimentDesign(run(file, seed, progress), file.warnings)
