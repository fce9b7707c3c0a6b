"""One run of an experiment file: `flexid.simulate`."""

from collections.abc import Mapping
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexid.library.answer import ReportedAnswer, data_frame
from flexid.library.checks import as_path
from flexid.library.entrance import entrance
from flexid.library.options import as_mapping, as_number

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from flexid.experiments.experiment import Experiment
    from flexid.experiments.measures import Measures
    from flexid.recording.recording import Log
    from flexid.report.charts.description import Chart
    from flexid.report.page.layout import Page
    from flexid.report.terminal import Part
    from flexid.simulation.run import Run


class SimulatedRun(ReportedAnswer):
    """A closed loop over time: plant, controller and observer.

    Parameters
    ----------
    experiment : Experiment
        What was simulated.
    result : Run
        What it did, with all states, inputs and estimates as arrays.
    """

    _file = "run.json"

    def __init__(self, experiment: "Experiment", result: "Run") -> None:
        self.experiment = experiment
        self.result = result

    @cached_property
    def measures(self) -> "Measures":
        """The run in numbers: final errors, settling times, tracking, excitation."""
        from flexid.experiments.measures import measure

        return measure(self.result)

    def _document(self) -> Mapping[str, Any]:
        import flexid
        from flexid.report.documents import excitation_summary

        experiment, run, measures = self.experiment, self.result, self.measures
        true = experiment.loop.coefficients
        return {
            "name": experiment.name,
            "status": "finished",
            "reached": float(run.time[-1]),
            "coefficients": {
                name: {
                    "true": true[name],
                    "initial": experiment.loop.initial_estimates.get(name, 0.0),
                    "final": float(run.estimates[-1, place]),
                    "final_error": measures.final_errors[name],
                    "settling_time": measures.settling_times[name],
                }
                for place, name in enumerate(experiment.loop.system.coefficients)
            },
            "final_states": measures.final_states,
            "tracking_rms": measures.tracking_rms,
            "tracking_peak": measures.tracking_peak,
            "peak_inputs": measures.peak_inputs,
            "excitation": {row: excitation_summary(e) for row, e in measures.excitation.items()},
            "statistics": run.statistics,
            "provenance": {
                "flexid_version": flexid.__version__,
                "experiment": experiment.path,
                "experiment_digest": experiment.digest,
                "mode": experiment.mode,
                "settings": experiment.settings.model_dump(),
                "tables": experiment.tables.model_dump(),
            },
        }

    def to_dataframe(self, backend: str = "polars") -> Any:
        """All time series as a data frame: the columns of ``run.parquet``.

        Parameters
        ----------
        backend : {"polars", "pandas", "pyarrow"}, optional
            Whose data frame; the library has to be installed.
        """
        from flexid.experiments.run_columns import run_columns

        return data_frame(run_columns(self.result), backend)

    def log(self) -> "Log":
        """What a drive would have logged, for `flexid.identify`.

        Raises
        ------
        RecordingError
            If the model is not that of a joint.
        """
        from flexid.experiments.run_columns import log_columns
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

    def _charts(self) -> "Sequence[Chart]":
        from flexid.report.run_charts import run_charts

        return run_charts(self.experiment.name, self.result)

    def _write_data(self, directory: Path, *, csv: bool) -> None:
        from flexid.report.run_series import save_run_series

        save_run_series(self.result, directory, csv)

    def _parts(self) -> "Iterable[Part]":
        from flexid.report.run_table import run_parts

        return run_parts(self.experiment, self.result, self.measures)

    def _page(self, command: str = "", out: str = "") -> "Page":
        from flexid.report.page.run_page import run_page

        log = str(Path(out) / "log.parquet") if out else ""
        return run_page(self.experiment, self.result, self.measures, self._drawn, command, log)

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
