"""Experiments: closed loops with all settings of a run, read from a file."""

import hashlib
import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from math import isfinite
from numbers import Integral
from pathlib import Path
from typing import Any, Literal

from flexid.errors import (
    AccelerationError,
    ExperimentError,
    ExpressionError,
    ModelError,
    SettingError,
    did_you_mean,
)
from flexid.experiments.tables import (
    ContinuousRun,
    ContinuousTables,
    FileModel,
    JointModel,
    SampledTables,
    Tables,
)
from flexid.experiments.variation import Variation, read_variation
from flexid.files import RefuseKey, parse_toml, read_small, validated
from flexid.models.flexible_joint import SMOOTHING
from flexid.models.parametric_system import ParametricSystem
from flexid.models.physical import TERM_PARAMETERS, joint_coefficients
from flexid.paper.laws import Controller, pd_gravity, robust_law
from flexid.paper.loop import Multisine, constant, sinusoid
from flexid.simulation.closed_loop import ClosedLoop, Run, simulate
from flexid.simulation.sampled import Sampling, simulate_sampled

_MOST_SAMPLES = 10_000_000  # of one run


@dataclass(frozen=True, eq=False)
class Experiment:
    """Closed loop and settings from an experiment file."""

    path: str  # the file
    system: ParametricSystem = field(repr=False)  # model, with the constants of its file
    tables: Tables = field(repr=False)  # without [campaign], with defaults
    loop: ClosedLoop = field(repr=False)  # loop with its values
    variation: Variation | None = field(default=None, repr=False)  # the [campaign] part

    @property
    def name(self) -> str:
        """Title of the experiment, or the name of its file."""
        return self.tables.name or self.path

    @property
    def mode(self) -> Literal["continuous", "sampled"]:
        """Whether controller and observer are sampled."""
        return "sampled" if isinstance(self.tables, SampledTables) else "continuous"

    @cached_property
    def settings(self) -> ContinuousRun:
        """Duration, sample time and tolerances of the run."""
        return self.tables.settings

    @cached_property
    def sampling(self) -> Sampling | None:
        """Sampling of the loop; None in continuous time."""
        if isinstance(self.tables, SampledTables):
            return Sampling(**self.tables.sampling.model_dump())
        return None

    @property
    def side_by_side(self) -> bool:
        """Whether its runs are vectorised: true in continuous time if they are not stiff."""
        return self.sampling is None and not self.settings.stiff

    @cached_property
    def values(self) -> dict[str, float]:
        """All numbers that can be set, by dotted path; list items count from 1."""
        return dict(_leaves(self.tables.model_dump()))

    @cached_property
    def digest(self) -> str:
        """Hash of everything that affects the result of a run."""
        system = self.loop.system
        decisive = self.tables.model_dump(exclude={"name"})
        content = [decisive, system.digest, list(system.constants.items())]
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:16]

    def with_values(self, values: Mapping[str, float]) -> "Experiment":
        """Return the experiment with other numbers, by dotted path such as ``controller.k``."""
        content = self.tables.model_dump()
        for path, value in values.items():
            if path not in self.values:
                remedy = did_you_mean(path, self.values)
                raise ExperimentError(self.path, path, f"cannot be set{remedy}")
            _set_value(content, path, int(value) if isinstance(value, Integral) else float(value))
        return declared_experiment(self.path, content, self)

    def run(self) -> Run:
        """Simulate the experiment."""
        settings = self.settings
        if self.sampling is not None:
            return simulate_sampled(self.loop, settings.duration, self.sampling)
        try:
            return simulate(self.loop, **settings.model_dump(exclude={"stiff"}))
        except AccelerationError as error:
            raise ExperimentError(
                self.path,
                "model",
                f"has a coefficient {error.coefficient!r} whose observer needs an acceleration in "
                f"continuous time: drop its term, or sample the loop with a table [sampling]",
            ) from None


def read_experiment(path: str | Path) -> Experiment:
    """Read an experiment file, with its table ``[campaign]`` if it has one."""
    path = Path(path)
    refuse = partial(ExperimentError, str(path))
    content = parse_toml(read_small(path, "an experiment file in TOML", refuse), refuse)
    campaign = content.pop("campaign", None)
    experiment = declared_experiment(str(path), content)
    if campaign is None:
        return experiment
    return replace(experiment, variation=read_variation(campaign, experiment))


def declared_experiment(
    path: str, content: Mapping[str, Any], like: Experiment | None = None
) -> Experiment:
    """Return the experiment of a file's tables; `like`, from the same file, provides the model."""
    refuse = partial(ExperimentError, path)
    schema = SampledTables if "sampling" in content else ContinuousTables
    tables = validated(content, schema, refuse)
    settings = tables.settings
    if settings.duration < settings.sample_time:
        raise refuse("run.duration", "is shorter than the sample time: lengthen it")
    if settings.duration > _MOST_SAMPLES * settings.sample_time:
        raise refuse("run.duration", f"makes more than {_MOST_SAMPLES} samples: shorten it")
    system = tables.model.system(Path(path).parent, refuse) if like is None else like.system
    tables = _completed(tables, system, refuse)
    loop = _loop(tables, system, refuse, None if like is None else like.loop)
    return Experiment(path, system, tables, loop, None if like is None else like.variation)


def _completed(tables: Tables, system: ParametricSystem, refuse: RefuseKey) -> Tables:
    """Return the tables with default values of constants, initial states and estimates."""
    state, states = tables.initial_state, system.states
    for name in state:
        if name not in states:
            raise refuse(f"initial_state.{name}", f"is unknown: the states are {', '.join(states)}")
    added: dict[str, Any] = {"initial_state": {name: state.get(name, 0.0) for name in states}}
    if isinstance(tables.model, FileModel):
        added["plant"] = {**system.constants, **tables.plant}
    zeros = dict.fromkeys(system.coefficients, 0.0)
    for name in tables.initial_estimates:
        if name not in zeros:
            raise refuse(f"initial_estimates.{name}", f"is unknown: take {', '.join(zeros)}")
    added["initial_estimates"] = zeros | tables.initial_estimates
    return tables.model_copy(update=added)


def _loop(
    tables: Tables, system: ParametricSystem, refuse: RefuseKey, like: ClosedLoop | None
) -> ClosedLoop:
    values, wanted = _plant(tables, system, refuse), tables.reference
    try:
        reference = _REFERENCES[wanted.kind](**wanted.model_dump(exclude={"kind"}))
    except ModelError as error:
        raise refuse("reference", error.reason) from None
    parts = {
        "system": system.with_constants({name: values[name] for name in system.constants}),
        "coefficients": {name: values[name] for name in system.coefficients},
        "observer_gains": tables.observer,
        "initial_estimates": tables.initial_estimates,
        "initial_state": tuple(tables.initial_state.values()),
        "reference": reference,
        "controller": _LAWS[tables.controller.law](**tables.controller.model_dump(exclude={"law"})),
    }
    if like is not None:
        return like.with_values(**parts)
    try:
        return ClosedLoop(**parts)
    except SettingError as error:
        raise refuse("observer", f"does not fit the model: {error.reason}") from None
    except (ModelError, ExpressionError) as error:
        raise refuse("controller", f"does not fit the model: {error}") from None


_REQUIRED = ("link_inertia", "motor_inertia", "joint_stiffness")


def _plant(tables: Tables, system: ParametricSystem, refuse: RefuseKey) -> Mapping[str, float]:
    """Return values of coefficients and constants, for a joint from physical parameters."""
    model, plant = tables.model, tables.plant
    of_joint = isinstance(model, JointModel)
    wanted = [*system.coefficients, *system.constants]
    if of_joint:
        wanted = [*_REQUIRED, *(TERM_PARAMETERS[term] for term in model.terms)]
    for name in plant:
        if name not in wanted:
            raise refuse(f"plant.{name}", f"is not in the model{did_you_mean(name, wanted)}")
    for name in wanted:
        if name not in plant:
            raise refuse(f"plant.{name}", "is missing: add it")
        if of_joint and name in _REQUIRED and not plant[name] > 0.0:
            raise refuse(f"plant.{name}", f"is {plant[name]:g}: give a positive number")
    if not of_joint:
        return plant
    values = joint_coefficients(plant)
    for name, value in values.items():
        if not isfinite(value):
            raise refuse("plant", f"makes {name} infinite: choose larger inertias")
    return {**values, SMOOTHING: model.coulomb_velocity}


_LAWS: dict[str, Callable[..., Controller]] = {
    "robust": robust_law,
    "pd-gravity": pd_gravity,
    "expressions": partial(Controller, "own law"),
}
_REFERENCES: dict[str, Callable[..., Multisine]] = {
    "sine": sinusoid,
    "multisine": Multisine,
    "constant": constant,
}
# Argument names equal the keys of the tables.


def _leaves(table: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Yield dotted paths of all numbers, including optional ones without a value."""
    if isinstance(table, Mapping):
        for key, value in table.items():
            yield from _leaves(value, f"{path}.{key}" if path else key)
    elif isinstance(table, list):
        for place, value in enumerate(table, start=1):
            yield from _leaves(value, f"{path}.{place}")
    elif table is None or (isinstance(table, int | float) and not isinstance(table, bool)):
        yield path, table


def _set_value(content: Any, path: str, number: float) -> None:
    *keys, last = path.split(".")
    for key in keys:
        content = content[int(key) - 1 if isinstance(content, list) else key]
    content[int(last) - 1 if isinstance(content, list) else last] = number
