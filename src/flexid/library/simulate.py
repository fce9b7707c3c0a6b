"""One run of an experiment file: `flexid.simulate`."""

from collections.abc import Mapping
from functools import cached_property
from os import PathLike
from typing import TYPE_CHECKING, Any

from flexid.library.answer import ReportedAnswer, TabularAnswer
from flexid.library.entrance import as_path, entrance
from flexid.library.options import as_mapping, as_number

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from flexid.experiments.experiment import Experiment
    from flexid.experiments.measures import Measures
    from flexid.recording.recording import Log
    from flexid.simulation.run import Run


class SimulatedRun(ReportedAnswer, TabularAnswer):
    """A closed loop over time: plant, controller and observer.

    As a data frame it has all time series: the columns of ``run.parquet``.

    Parameters
    ----------
    experiment : Experiment
        What was simulated.
    result : Run
        What it did, with all states, inputs and estimates as arrays.
    """

    _report = "simulated_run"
    _file = "run.json"

    def __init__(self, experiment: "Experiment", result: "Run") -> None:
        self.experiment = experiment
        self.result = result

    @cached_property
    def measures(self) -> "Measures":
        """The run in numbers: final errors, settling times, tracking, excitation."""
        from flexid.experiments.measures import measure

        return measure(self.result)

    def log(self) -> "Log":
        """What a drive would have logged, for `flexid.identify`.

        Raises
        ------
        RecordingError
            If the model is not that of a joint.
        """
        from flexid.experiments.measures import log_columns
        from flexid.library.logs import all_logs

        return all_logs("log", log_columns(self.result), None)[0]

    def plot_motion(self, ax: "Axes | None" = None) -> "Figure":
        """Reference and tracked state, the error between them, and the inputs.

        Parameters
        ----------
        ax : Axes, optional
            In whose place the panels are drawn.
        """
        from flexid.report.charts.figure import draw

        return draw(self._drawn[0], ax=ax)

    def plot_estimates(self, ax: "Axes | None" = None) -> "Figure":
        """Every estimate over time, with the true value and the band in which it is settled.

        Parameters
        ----------
        ax : Axes, optional
            In whose place the panels are drawn.
        """
        from flexid.report.charts.figure import draw

        return draw(self._drawn[1], ax=ax)

    @property
    def _shown(self) -> tuple[Any, ...]:
        return self.experiment, self.result, self.measures

    def _columns(self) -> Mapping[str, Any]:
        from flexid.experiments.measures import run_columns

        return run_columns(self.result)

    def __repr__(self) -> str:
        return f"<SimulatedRun: {self.experiment.name}, {self.result.time[-1]:g} s>"


@entrance
def simulate(
    experiment: "str | PathLike[str]",
    *,
    set: Mapping[str, float] | None = None,  # noqa: A002 - as the command calls it
) -> SimulatedRun:
    """Simulate a closed loop with an observer, from a file.

    Plant, controller, reference, observer, sensors and noise stand in the experiment file.

    Parameters
    ----------
    experiment : path
        A TOML file.
    set : mapping of str to float, optional
        Numbers that replace those of the file, by dotted path. For example
        ``{"controller.k": 30.0}``.

    Returns
    -------
    SimulatedRun
        Time series, measures and figures.

    Raises
    ------
    ExperimentError
        If the file cannot be used, or has no such number.
    SimulationError
        If the loop diverges or cannot meet its tolerance.
    ArgumentError
        If an option is unknown or of a wrong type.
    """
    from flexid.experiments import read_experiment

    values = as_mapping("simulate", "set", set, "{'controller.k': 30.0}")
    for path, value in values.items():
        as_number("simulate", f"set[{path!r}]", value)
    chosen = read_experiment(as_path("simulate", "experiment", experiment)).with_values(values)
    return SimulatedRun(chosen, chosen.run())
