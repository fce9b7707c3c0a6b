"""What a campaign's directory says about itself: ``campaign.json``."""

import json
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from flexid.atomic import write_atomically
from flexid.errors import CampaignError
from flexid.experiments.variation import MOST_RUNS

FILE = "campaign.json"


@dataclass(frozen=True)
class Manifest:
    """What was planned; it decides every row of the campaign."""

    flexid: str  # version that runs it
    experiment: str  # digest of whatever decides a run's result
    plan: str  # digest of all values
    kind: str  # kind of the plan
    runs: int  # number of runs
    inputs: tuple[str, ...]  # dotted paths of what varies
    keep: tuple[str, ...]  # what is kept of each run
    runs_per_part: int  # how many runs share a file
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
    text = json.dumps(asdict(manifest), indent=2, ensure_ascii=False) + "\n"
    write_atomically(directory / FILE, lambda path: path.write_text(text, encoding="utf-8"))


def read_manifest(directory: Path) -> Manifest | None:
    """Read ``campaign.json``; None where there is none."""
    try:
        content = json.loads((directory / FILE).read_text(encoding="utf-8"))
        return _manifest(content)
    except FileNotFoundError:
        return None
    except NotADirectoryError:
        raise CampaignError(str(directory), "is no directory: give one") from None
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise CampaignError(
            str(directory / FILE),
            "is damaged or of no campaign: start anew in another directory",
        ) from None


def _manifest(content: dict[str, Any]) -> Manifest:
    values: dict[str, Any] = {}
    for field in fields(Manifest):
        value = content[field.name]
        if field.type in (str, int) and type(value) is not field.type:
            raise TypeError(field.name)
        values[field.name] = value if field.type in (str, int) else _names(value)
    if not 1 <= values["runs"] <= MOST_RUNS or values["runs_per_part"] < 1:
        raise ValueError("runs")
    return Manifest(**values)


def _names(value: object) -> tuple[str, ...]:
    if not isinstance(value, list) or not all(isinstance(name, str) for name in value):
        raise TypeError("names")
    return tuple(map(str, value))


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
