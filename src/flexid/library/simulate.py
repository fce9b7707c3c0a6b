"""Simulated experiments: `flexid.simulate`, `flexid.campaign` and `flexid.reproduce`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexid.errors import SettingError
from flexid.identification.vocabulary import Progress, silent
from flexid.library.answer import Answer
from flexid.library.arguments import entrance, one_thread

if TYPE_CHECKING:
    import polars as pl

    from flexid.experiments.campaign_store import Summary
    from flexid.experiments.experiment import Experiment
    from flexid.experiments.measures import Measures
    from flexid.library.arguments import FilePath
    from flexid.recording.recording import Log
    from flexid.simulation.closed_loop import Run
    from flexid.studies.reproduction import Claim, Reproduction


class SimulatedRun(Answer):
    """Simulated closed loop of plant, controller and observer."""

    _report = "simulated_run"
    _file = "run.json"

    def __init__(self, experiment: Experiment, result: Run) -> None:
        self.experiment = experiment
        self.result = result  # all states, inputs and estimates as arrays

    @cached_property
    def measures(self) -> Measures:
        """Figures of the run: final errors, settling times, tracking errors, excitation."""
        from flexid.experiments.measures import measure

        return measure(self.result)

    def log(self) -> Log:
        """Return the log that a drive would record, for `flexid.identify`."""
        from flexid.experiments.measures import log_columns
        from flexid.library.logs import read_log

        return read_log(log_columns(self.result))

    @property
    def _shown(self) -> tuple[Any, ...]:
        return self.experiment, self.result, self.measures

    def to_dataframe(self) -> pl.DataFrame:
        """Return all time series as a Polars data frame, with the columns of ``run.parquet``."""
        import polars as pl

        from flexid.experiments.measures import run_columns

        return pl.DataFrame(run_columns(self.result))

    def __repr__(self) -> str:
        return f"<SimulatedRun: {self.experiment.name}, {self.result.time[-1]:g} s>"


@entrance
def simulate(
    experiment: FilePath,
    *,
    set: Mapping[str, float] | None = None,  # noqa: A002 - as the command calls it
) -> SimulatedRun:
    """Simulate a closed loop with an observer, from a file.

    The experiment file defines plant, controller, reference, observer, sensors and noise.

    Parameters
    ----------
    experiment : path
        A TOML file with the experiment.
    set : mapping of str to float, optional
        Values that replace numbers of the file, by dotted path. For example
        ``{"controller.k": 30.0}``.
    """
    from flexid.experiments.experiment import read_experiment

    chosen = read_experiment(Path(experiment)).with_values(set or {})
    return SimulatedRun(chosen, chosen.run())


class CampaignResult(Answer):
    """Summary of a campaign, which may be unfinished."""

    _report = "campaign"
    _file = "summary.json"

    result: Summary
    directory: Path
    """Directory of the rows."""
    statuses: Mapping[str, int]
    """Number of runs by status, the most frequent first."""
    complete: bool
    """Whether every run has its row."""

    def __repr__(self) -> str:
        statuses = ", ".join(f"{name} {count}" for name, count in self.statuses.items())
        return (
            f"<CampaignResult: {self.result.done} of {self.result.manifest.runs} runs: {statuses}>"
        )


@entrance
def campaign(
    experiment: FilePath | None = None,
    *,
    out: FilePath | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    summary: FilePath | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> CampaignResult:
    """Run an experiment many times, or summarise its runs.

    The file's table named campaign defines what varies. The same command continues an interrupted
    campaign, which ends with the same rows as without the interruption.

    Parameters
    ----------
    experiment : path, optional
        A TOML file with a table named campaign.
    out : path, optional
        Directory of the rows; an unfinished campaign there is continued.
    workers : int, optional
        Number of threads; by default one for each core.
    scheduler : str, optional
        Address of a Dask scheduler whose workers run the campaign, such as tcp://host:8786.
    summary : path, optional
        Directory of a campaign to summarise; nothing is run.
    progress : callable, optional
        Called with the number of runs whose rows are stored, and the number of all runs.
    """
    from flexid.experiments.campaign_runner import run_campaign
    from flexid.experiments.campaign_store import summarise
    from flexid.experiments.experiment import read_experiment

    given = {"experiment": experiment, "out": out, "workers": workers, "scheduler": scheduler}
    chosen = [name for name, value in given.items() if value is not None]
    if summary is not None:
        if chosen:
            raise SettingError(chosen[0], "does not go with summary: leave it out")
        return CampaignResult(summarise(Path(summary)))
    if experiment is None or out is None:
        missing = "experiment" if experiment is None else "out"
        raise SettingError(missing, "is missing: give a path, or a summary")
    if workers is not None and scheduler is not None:
        raise SettingError("workers", "is for this machine: leave it out with a scheduler")
    directory = Path(out)
    run_campaign(read_experiment(Path(experiment)), directory, workers, scheduler, progress)
    return CampaignResult(summarise(directory))


class PaperReproduction(Answer):
    """Reproduction of Huang (2003): Table I, Figures 1 to 5, readings of the law, claims."""

    _report = "reproduction"
    _formats = ("png", "pdf")

    result: Reproduction
    claims: tuple[Claim, ...]
    """The paper's claims, each with its verdict."""

    def __repr__(self) -> str:
        verdicts = [claim.verdict for claim in self.claims]
        return f"<PaperReproduction: {verdicts.count('holds')} of {len(verdicts)} claims hold>"


@entrance
@one_thread()
def reproduce(*, progress: Progress = silent) -> PaperReproduction:
    """Reproduce the paper Huang (2003), and check its claims.

    Covers Table I, Figures 1 to 5, both readings of the control law, and every claim.

    Parameters
    ----------
    progress : callable, optional
        Called with the name of each completed part.
    """
    from flexid.studies.reproduction import reproduce as run

    return PaperReproduction(run(progress))
