"""Many runs of an experiment file: `flexid.campaign`."""

from collections.abc import Callable, Mapping
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexid.errors import ArgumentError
from flexid.library.answer import ReportedAnswer, TabularAnswer
from flexid.library.entrance import as_path, entrance, kind_of

if TYPE_CHECKING:
    from flexid.campaigns import Summary


class CampaignResult(ReportedAnswer, TabularAnswer):
    """What a campaign says, finished or not; as a data frame, a row for each run that is done.

    Parameters
    ----------
    result : Summary
        Statuses, distributions, and which input matters.
    """

    _report = "campaign"
    _file = "summary.json"

    def __init__(self, result: "Summary") -> None:
        self.result = result

    @property
    def directory(self) -> Path:
        """Where the rows are."""
        return self.result.directory

    @property
    def statuses(self) -> Mapping[str, int]:
        """How many runs ended how, the most frequent first."""
        return self.result.statuses

    @property
    def complete(self) -> bool:
        """Whether every run has its row."""
        return self.result.complete

    def _columns(self) -> Mapping[str, Any]:
        from flexid.campaigns.summary import campaign_rows

        return campaign_rows(self.directory).to_dict(as_series=False)

    def __repr__(self) -> str:
        statuses = ", ".join(f"{name} {count}" for name, count in self.statuses.items())
        return (
            f"<CampaignResult: {self.result.done} of {self.result.manifest.runs} runs: {statuses}>"
        )


@entrance
def campaign(
    experiment: "str | PathLike[str] | None" = None,
    *,
    out: "str | PathLike[str] | None" = None,
    workers: int | None = None,
    scheduler: str | None = None,
    summary: "str | PathLike[str] | None" = None,
    progress: Callable[[int, int], None] | None = None,
) -> CampaignResult:
    """Run an experiment many times, or summarise such runs.

    What varies stands in the file's table named campaign. A campaign that was interrupted goes on
    with the same command, and ends with the same rows.

    Parameters
    ----------
    experiment : path, optional
        A TOML file with a table named campaign.
    out : path, optional
        Directory of the rows; a campaign begun there goes on.
    workers : int, optional
        Threads; all cores if not given.
    scheduler : str, optional
        Address of a Dask scheduler whose workers run it instead, such as tcp://host:8786.
    summary : path, optional
        Directory of a campaign to summarise instead.
    progress : callable, optional
        Called with the number of runs whose rows are kept, and the number of all.

    Returns
    -------
    CampaignResult
        Rows, statuses, distributions, and which input matters.

    Raises
    ------
    ExperimentError
        If the file cannot be used, or says nothing of a campaign.
    CampaignError
        If a directory or the scheduler cannot be used.
    ArgumentError
        If an option is unknown, missing, or of a wrong type.
    """
    from flexid.campaigns import run_campaign, summarise
    from flexid.experiments import read_experiment

    if summary is not None:
        given = {"experiment": experiment, "out": out, "workers": workers, "scheduler": scheduler}
        for name, value in given.items():
            if value is not None:
                raise ArgumentError("campaign", name, "does not go with summary: leave it out")
        return CampaignResult(summarise(as_path("campaign", "summary", summary)))
    path = as_path("campaign", "experiment", experiment)
    directory = as_path("campaign", "out", out)
    if workers is not None and (isinstance(workers, bool) or not isinstance(workers, int)):
        raise ArgumentError("campaign", "workers", f"is {kind_of(workers)}: give a whole number")
    if scheduler is not None and not isinstance(scheduler, str):
        raise ArgumentError("campaign", "scheduler", f"is {kind_of(scheduler)}: give an address")
    run_campaign(read_experiment(path), directory, workers, scheduler, progress)
    return CampaignResult(summarise(directory))
