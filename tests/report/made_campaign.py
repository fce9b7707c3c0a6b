"""A campaign of 100 runs made by hand."""

from pathlib import Path

from flexid.experiments.campaign_store import Manifest, Result, Summary


def made_of(name="tracking_rms"):
    """Return a result."""
    return Result(name, 2, 1, (1.0, 1.5, 2.0))


def made_summary(done=100, statuses=None, damaged=(), first_error="", results=()):
    """Return a summary of the campaign."""
    manifest = Manifest(
        flexid="1.0",
        experiment="0123",
        plan="4567",
        kind="sobol",
        runs=100,
        inputs=("controller.k",),
        runs_per_part=10,
        text="the file",
    )
    statuses = statuses or {"finished": done}
    return Summary(Path("out"), manifest, done, damaged, statuses, first_error, results)
