"""An experiment: a closed loop with everything that a run of it needs."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from functools import cached_property
from numbers import Integral
from typing import Any, Literal

from flexid.errors import AccelerationError, ExperimentError
from flexid.experiments.frame import Frame, RunSettings, checked
from flexid.experiments.variation import Variation
from flexid.simulation.closed_loop import simulate
from flexid.simulation.loop import ClosedLoop
from flexid.simulation.run import Run
from flexid.simulation.sampled import Sampling, simulate_sampled

Tables = Mapping[str, Any]


@dataclass(frozen=True, eq=False)
class Experiment:
    """What an experiment file says."""

    frame: Frame = field(repr=False)  # what the names in it decide
    # the file's tables but the campaign's, complete with what it leaves to the defaults
    tables: Tables = field(repr=False)
    # model, true coefficients, controller, reference, observer and where they start
    loop: ClosedLoop = field(repr=False)
    settings: RunSettings
    sampling: Sampling | None  # of a sampled loop; None for a continuous one
    # the [campaign] part, if there is one
    variation: Variation | None = field(default=None, repr=False)

    @property
    def path(self) -> str:
        """The file."""
        return self.frame.path

    @property
    def name(self) -> str:
        """Title of the experiment, or the name of its file."""
        return self.tables["name"] or self.path

    @property
    def mode(self) -> Literal["continuous", "sampled"]:
        """Whether controller and observer are sampled."""
        return "continuous" if self.sampling is None else "sampled"

    @property
    def side_by_side(self) -> bool:
        """Whether runs of it go side by side: continuous ones that are not stiff."""
        return self.sampling is None and not self.settings.stiff

    @property
    def duration(self) -> float:
        """Length of a run in s."""
        return self.settings.duration

    @property
    def sample_time(self) -> float:
        """Distance of the samples in s."""
        return self.settings.sample_time

    @property
    def relative_tolerance(self) -> float:
        """Error allowed per step of a continuous run, relative to the value."""
        return self.settings.relative_tolerance

    @property
    def absolute_tolerance(self) -> float:
        """The same in SI units."""
        return self.settings.absolute_tolerance

    @property
    def maximum_steps(self) -> int:
        """Steps after which a continuous run is given up."""
        return self.settings.maximum_steps

    @cached_property
    def values(self) -> dict[str, float]:
        """Every number that can be set, by its dotted path; places in a list count from 1."""
        return dict(_leaves(self.tables))

    @cached_property
    def digest(self) -> str:
        """Hash of everything that decides the result of a run."""
        decisive = {key: table for key, table in self.tables.items() if key != "name"}
        system = self.loop.system
        content = [decisive, system.digest, list(system.constants.items())]
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:16]

    def with_values(self, values: Mapping[str, float]) -> "Experiment":
        """Return the same experiment with other numbers in its file."""
        known = self.values
        tables: dict[str, Any] = dict(self.tables)
        for path, value in values.items():
            if path not in known:
                raise ExperimentError(self.path, path, f"cannot be set: {suggestion(path, known)}")
            number = int(value) if isinstance(value, Integral) else float(value)
            _put(tables, path.split("."), number)
        frame = self.frame
        content = frame.completed(checked(tables, frame.kinds, frame.refuse))
        return replace(
            self,
            tables=content,
            settings=frame.settings(content),
            loop=frame.loop(content, self.loop),
            sampling=frame.sampling(content),
        )

    def run(self) -> Run:
        """Simulate the experiment."""
        if self.sampling is not None:
            return simulate_sampled(self.loop, self.duration, self.sampling)
        try:
            return simulate(
                self.loop,
                self.duration,
                self.sample_time,
                self.relative_tolerance,
                self.absolute_tolerance,
                self.maximum_steps,
                stiff=self.settings.stiff,
            )
        except AccelerationError as error:
            raise ExperimentError(
                self.path,
                "model",
                f"has a coefficient {error.coefficient!r} whose observer needs an acceleration in "
                f"continuous time: drop its term, or sample the loop with a table [sampling]",
            ) from None


def suggestion(path: str, known: Mapping[str, float]) -> str:
    """What to write instead of a path that there is not."""
    close = get_close_matches(path, known, n=3, cutoff=0.75)
    return f"write {' or '.join(close)}" if close else f"write one of {', '.join(known)}"


def _leaves(table: Any, path: str = "") -> Any:
    """Dotted paths of all numbers; what has no value yet counts as one."""
    if isinstance(table, Mapping):
        for key, value in table.items():
            yield from _leaves(value, f"{path}.{key}" if path else key)
    elif isinstance(table, list):
        for place, value in enumerate(table, start=1):
            yield from _leaves(value, f"{path}.{place}")
    elif table is None or (isinstance(table, int | float) and not isinstance(table, bool)):
        yield path, table


def _put(tables: dict[str, Any], keys: list[str], number: float) -> None:
    """Replace a leaf; what holds it is copied, since other experiments share it."""
    holder: Any = tables
    for key in keys[:-1]:
        inner = holder[int(key) - 1] if isinstance(holder, list) else holder[key]
        inner = list(inner) if isinstance(inner, list) else dict(inner)
        _set(holder, key, inner)
        holder = inner
    _set(holder, keys[-1], number)


def _set(holder: Any, key: str, value: Any) -> None:
    holder[int(key) - 1 if isinstance(holder, list) else key] = value
