"""An experiment: a closed loop with everything that a run of it needs."""

import hashlib
import json
from collections.abc import Callable, Collection, Iterator, Mapping
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
    Reference,
    SampledTables,
    Tables,
)
from flexid.experiments.variation import Variation, read_variation
from flexid.models.flexible_joint import POSITIVE
from flexid.models.parametric_system import ParametricSystem
from flexid.models.physical import JOINT_PARAMETERS, joint_coefficients
from flexid.paper.laws import Controller, pd_gravity, robust_law
from flexid.paper.loop import Multisine, constant, sinusoid
from flexid.simulation.closed_loop import ClosedLoop, Run, simulate
from flexid.simulation.sampled import Sampling, simulate_sampled
from flexid.toml_file import Refuse, parse_toml, read_bytes, validated

Values = Mapping[str, float]

_INERTIAS = ("link_inertia", "motor_inertia")


def coefficient_values(
    table: str,
    values: Values,
    names: Collection[str],
    joint: bool,
    refuse: Refuse,
    *,
    needed: Collection[str] = (),
    known: Collection[str] = (),
) -> dict[str, float]:
    """The values of a table by coefficient, of which those needed must be there.

    A table of a joint may hold physical parameters instead; known coefficients may follow from
    these.
    """
    found = dict(values)
    if not all(name in names for name in values):
        found = _of_physical(table, values, names, JOINT_PARAMETERS if joint else (), refuse)
    for name in found:
        if name not in names and name not in known:
            raise refuse(
                f"{table}.{_source(name, values)}",
                "belongs to a term that the model does not have: add that to model.terms, or "
                "remove this",
            )
    for name in needed:
        if name not in found:
            raise refuse(table, f"gives no value for the coefficient {name!r}: add one")
    return found


def _of_physical(
    table: str,
    values: Values,
    names: Collection[str],
    physical: Collection[str],
    refuse: Refuse,
) -> dict[str, float]:
    for name in values:
        if name not in names and name not in physical:
            others = f", or instead {', '.join(physical)}" if physical else ""
            raise refuse(f"{table}.{name}", f"is unknown: take {', '.join(names)}{others}")
    for name in values:
        if name in names:
            raise refuse(
                f"{table}.{name}",
                "is mixed with physical parameters: give either those or coefficients",
            )
    for name in _INERTIAS:
        if not values.get(name, 0.0) > 0.0:
            raise refuse(f"{table}.{name}", "must be there and positive: correct it")
    coefficients = joint_coefficients(values)
    for name, value in coefficients.items():
        if not isfinite(value):
            raise refuse(table, f"makes {name} infinite: choose larger inertias")
    return coefficients


def _source(coefficient: str, values: Values) -> str:
    """The key that a coefficient comes from: its own, or the physical parameter's."""
    if coefficient in values:
        return coefficient
    inertias = dict.fromkeys(_INERTIAS, 1.0)
    return next(n for n in values if coefficient in joint_coefficients({**inertias, n: 1.0}))


_MOST_SAMPLES = 10_000_000  # most samples of one run


@dataclass(frozen=True, eq=False)
class Experiment:
    """What an experiment file says."""

    path: str  # the file
    system: ParametricSystem = field(repr=False)  # the model, constants as its file declares them
    tables: Tables = field(repr=False)  # but the campaign's; complete with what the file leaves out
    loop: ClosedLoop = field(repr=False)  # everything with its values
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
        """How long the loop runs, how far its samples are apart, and how it is integrated."""
        return self.tables.settings

    @cached_property
    def sampling(self) -> Sampling | None:
        """How the loop is sampled; None for a continuous one."""
        if isinstance(self.tables, SampledTables):
            return Sampling(**self.tables.sampling.model_dump())
        return None

    @property
    def side_by_side(self) -> bool:
        """Whether runs of it go side by side: continuous ones that are not stiff."""
        return self.sampling is None and not self.settings.stiff

    @cached_property
    def values(self) -> dict[str, float]:
        """Every number that can be set, by its dotted path; places in a list count from 1."""
        return dict(_leaves(self.tables.model_dump()))

    @cached_property
    def digest(self) -> str:
        """Hash of everything that decides the result of a run."""
        system = self.loop.system
        decisive = self.tables.model_dump(exclude={"name"})
        content = [decisive, system.digest, list(system.constants.items())]
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:16]

    def with_values(self, values: Mapping[str, float]) -> "Experiment":
        """The same experiment with other numbers, by dotted path, such as ``controller.k``."""
        content = self.tables.model_dump()
        for path, value in values.items():
            if path not in self.values:
                remedy = did_you_mean(path, self.values)
                raise ExperimentError(self.path, path, f"cannot be set{remedy}")
            _put(content, path, int(value) if isinstance(value, Integral) else float(value))
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
    """Read an experiment file with a table for each part, and perhaps one of a campaign."""
    path = Path(path)
    refuse = partial(ExperimentError, str(path))
    content = parse_toml(read_bytes(path, "an experiment file in TOML", refuse), refuse)
    campaign = content.pop("campaign", None)
    experiment = declared_experiment(str(path), content)
    if campaign is None:
        return experiment
    return replace(experiment, variation=read_variation(campaign, experiment))


def declared_experiment(
    path: str, content: Mapping[str, Any], like: Experiment | None = None
) -> Experiment:
    """The experiment of a file's tables but the campaign's.

    With another one of the same file it shares model and declaration, which only names decide.
    """
    refuse = partial(ExperimentError, path)
    tables = _checked(content, refuse)
    system = tables.model.system(Path(path).parent, refuse) if like is None else like.system
    tables = _completed(tables, system, refuse)
    loop = _loop(tables, system, refuse, None if like is None else like.loop)
    return Experiment(path, system, tables, loop, None if like is None else like.variation)


def _checked(content: Mapping[str, Any], refuse: Refuse) -> Tables:
    schema = SampledTables if "sampling" in content else ContinuousTables
    tables = validated(content, schema, refuse)
    settings = tables.settings
    if settings.duration < settings.sample_time:
        raise refuse("run.duration", "is shorter than the sample time: lengthen it")
    if settings.duration > _MOST_SAMPLES * settings.sample_time:
        raise refuse("run.duration", f"makes more than {_MOST_SAMPLES} samples: shorten it")
    return tables


def _completed(tables: Tables, system: ParametricSystem, refuse: Refuse) -> Tables:
    """The tables with what the file leaves to the model: constants, zeros at the start."""
    state, states = tables.initial_state, system.states
    for name in state:
        if name not in states:
            raise refuse(f"initial_state.{name}", f"is unknown: the states are {', '.join(states)}")
    added: dict[str, Any] = {"initial_state": {name: state.get(name, 0.0) for name in states}}
    if isinstance(tables.model, FileModel):
        added["plant"] = {**system.constants, **tables.plant}
    if set(tables.initial_estimates) <= set(system.coefficients):
        zeros = dict.fromkeys(system.coefficients, 0.0)
        added["initial_estimates"] = zeros | tables.initial_estimates
    return tables.model_copy(update=added)


def _loop(
    tables: Tables, system: ParametricSystem, refuse: Refuse, like: ClosedLoop | None
) -> ClosedLoop:
    model, joint = tables.model, isinstance(tables.model, JointModel)
    known = model.known if isinstance(model, JointModel) else system.constants
    names = (*system.coefficients, *known)
    values = coefficient_values("plant", tables.plant, names, joint, refuse, needed=names)
    for name in sorted(POSITIVE) if joint else ():
        if not values.get(name, 1.0) > 0.0:
            source = _source(name, tables.plant)
            raise refuse(f"plant.{source}", f"is {tables.plant[source]:g}: give a positive number")
    guessed = coefficient_values(
        "initial_estimates",
        tables.initial_estimates,
        system.coefficients,
        joint,
        refuse,
        known=known,
    )
    constants = {name: values[name] for name in system.constants if name in values}
    if isinstance(model, JointModel) and "coulomb_velocity" in system.constants:
        constants["coulomb_velocity"] = model.coulomb_velocity
    parts = {
        "system": system.with_constants(constants),
        "coefficients": {name: values[name] for name in system.coefficients},
        "observer_gains": tables.observer,
        "initial_estimates": {name: guessed.get(name, 0.0) for name in system.coefficients},
        "initial_state": tuple(tables.initial_state.values()),
        "reference": _reference(tables.reference, refuse),
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
# Their arguments are called as the keys of their tables.


def _reference(table: Reference, refuse: Refuse) -> Multisine:
    try:
        return _REFERENCES[table.kind](**table.model_dump(exclude={"kind"}))
    except ModelError as error:
        raise refuse("reference", error.reason) from None


def _leaves(table: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Dotted paths of all numbers; what has no value yet counts as one."""
    if isinstance(table, Mapping):
        for key, value in table.items():
            yield from _leaves(value, f"{path}.{key}" if path else key)
    elif isinstance(table, list):
        for place, value in enumerate(table, start=1):
            yield from _leaves(value, f"{path}.{place}")
    elif table is None or (isinstance(table, int | float) and not isinstance(table, bool)):
        yield path, table


def _put(content: Any, path: str, number: float) -> None:
    *keys, last = path.split(".")
    for key in keys:
        content = content[int(key) - 1 if isinstance(content, list) else key]
    content[int(last) - 1 if isinstance(content, list) else last] = number
