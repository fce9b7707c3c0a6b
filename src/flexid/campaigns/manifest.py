"""What a campaign's directory says about itself: ``campaign.json``."""

from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from flexid.atomic import write_atomically
from flexid.errors import CampaignError
from flexid.experiments.variation import MOST_RUNS

FILE = "campaign.json"


class Manifest(BaseModel):
    """What was planned; it decides every row of the campaign."""

    model_config = ConfigDict(strict=True, frozen=True)

    flexid: str  # version that runs it
    experiment: str  # digest of what decides a run's result
    plan: str  # digest of all values
    kind: str  # of the plan
    runs: Annotated[int, Field(ge=1, le=MOST_RUNS)]
    inputs: tuple[str, ...]  # dotted paths of what varies
    keep: tuple[str, ...]  # what is kept of each run
    runs_per_part: Annotated[int, Field(ge=1)]  # runs that share a file
    text: str  # the experiment file as it was

    @property
    def parts(self) -> range:
        """Numbers of all parts."""
        return range(-(-self.runs // self.runs_per_part))

    def runs_of(self, part: int) -> range:
        """Numbers of the runs in a part."""
        first = part * self.runs_per_part
        return range(first, min(first + self.runs_per_part, self.runs))


def write_manifest(manifest: Manifest, directory: Path) -> None:
    """Write ``campaign.json``."""
    text = manifest.model_dump_json(indent=2) + "\n"
    write_atomically(directory / FILE, lambda path: path.write_text(text, encoding="utf-8"))


def read_manifest(directory: Path) -> Manifest | None:
    """Read ``campaign.json``; None if it is missing."""
    try:
        return Manifest.model_validate_json((directory / FILE).read_bytes())
    except FileNotFoundError:
        return None
    except NotADirectoryError:
        raise CampaignError(str(directory), "is no directory: give one") from None
    except (OSError, ValidationError):
        raise CampaignError(
            str(directory / FILE),
            "is damaged or of no campaign: start again in another directory",
        ) from None


def refuse_another(found: Manifest, wanted: Manifest, directory: Path) -> None:
    """Refuse a directory whose rows would not be those that are wanted.

    The number of runs per part may differ: it changes no row.
    """
    if found.flexid != wanted.flexid:
        what = f"a campaign of flexid {found.flexid}, and this is {wanted.flexid}"
    elif found.experiment != wanted.experiment:
        what = "a campaign of another experiment"
    elif found.plan != wanted.plan:
        what = "a campaign of the same experiment in which something else varies"
    elif (found.kind, found.runs, found.inputs) != (wanted.kind, wanted.runs, wanted.inputs):
        what = f"a {FILE} that was changed by hand"
    elif set(found.keep) != set(wanted.keep):
        what = f"a campaign that keeps other results ({', '.join(found.keep)})"
    else:
        return
    raise CampaignError(str(directory), f"holds {what}: give another directory")
