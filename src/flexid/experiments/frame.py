"""What the names in an experiment file decide: the model and the kinds of its tables."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

from flexid.errors import ExperimentError, ExpressionError, ModelError, SettingError
from flexid.experiments.parts import (
    declared_controller,
    declared_reference,
    declared_system,
    estimate_values,
    plant_values,
)
from flexid.models.parametric_system import ParametricSystem
from flexid.simulation.loop import ClosedLoop
from flexid.simulation.sampled import Sampling
from flexid.toml_file import Refuse, validated

MOST_SAMPLES = 10_000_000
"""Most samples of one run."""


@dataclass(frozen=True)
class RunSettings:
    """How long a loop runs and how closely it is integrated."""

    duration: float  # in s
    sample_time: float  # distance of the samples in s
    relative_tolerance: float = 1e-6  # of a continuous run
    absolute_tolerance: float = 1e-9  # of a continuous run
    maximum_steps: int = 1_000_000  # of a continuous run
    stiff: bool = True  # whether a continuous run is integrated by the method for stiff loops


@dataclass(frozen=True)
class Kinds:
    """Which of the possible tables a file has."""

    joint: bool  # whether the model is the flexible joint, and not in a file of its own
    law: str
    reference: str  # its kind
    sampled: bool  # whether the loop is sampled


@dataclass(frozen=True)
class Frame:
    """Makes the parts of an experiment of its tables; the same for all numbers in them."""

    path: str  # the file, for messages
    kinds: Kinds
    system: ParametricSystem  # the model, with the values of its constants as declared

    @property
    def refuse(self) -> Refuse:
        """Makes the error about a key of the file."""
        return partial(ExperimentError, self.path)

    def completed(self, content: dict[str, Any]) -> dict[str, Any]:
        """Checked tables with what the file leaves to the model: constants, zeros at the start."""
        content = dict(content)
        state, states = content["initial_state"], self.system.states
        for name in state:
            if name not in states:
                raise self.refuse(
                    f"initial_state.{name}", f"is unknown: the states are {', '.join(states)}"
                )
        content["initial_state"] = {name: state.get(name, 0.0) for name in states}
        if not self.kinds.joint:
            content["plant"] = {**self.system.constants, **content["plant"]}
        coefficients = self.system.coefficients
        if all(name in coefficients for name in content["initial_estimates"]):
            zeros = dict.fromkeys(coefficients, 0.0)
            content["initial_estimates"] = zeros | content["initial_estimates"]
        if not self.kinds.sampled:
            del content["sampling"]
        return content

    def settings(self, content: Mapping[str, Any]) -> RunSettings:
        """How a loop of these tables runs."""
        run = content["run"]
        if self.kinds.sampled:
            settings = RunSettings(run["duration"], content["sampling"]["sample_time"])
        else:
            if run["absolute_tolerance"] is None:
                run = {**run, "absolute_tolerance": 1e-3 * run["relative_tolerance"]}
            settings = RunSettings(**run)
        if settings.duration < settings.sample_time:
            raise self.refuse("run.duration", "is shorter than the sample time: lengthen it")
        if settings.duration > MOST_SAMPLES * settings.sample_time:
            raise self.refuse("run.duration", f"makes more than {MOST_SAMPLES} samples: shorten it")
        return settings

    def sampling(self, content: Mapping[str, Any]) -> Sampling | None:
        """How a loop of these tables is sampled; None for a continuous one."""
        return Sampling(**content["sampling"]) if self.kinds.sampled else None

    def loop(self, content: Mapping[str, Any], like: ClosedLoop | None = None) -> ClosedLoop:
        """The loop of these tables; with another one of the file it shares its declaration."""
        system, refuse, joint = self.system, self.refuse, self.kinds.joint
        needed = content["model"]["known"] if joint else system.constants
        names = (*system.coefficients, *needed)
        values = plant_values(content["plant"], names, joint, refuse)
        constants = {name: values[name] for name in system.constants if name in values}
        if joint and "coulomb_velocity" in system.constants:
            constants["coulomb_velocity"] = content["model"]["coulomb_velocity"]
        parts = {
            "coefficients": {name: values[name] for name in system.coefficients},
            "observer_gains": content["observer"],
            "initial_estimates": estimate_values(
                content["initial_estimates"], system.coefficients, names, joint, refuse
            ),
            "initial_state": tuple(content["initial_state"].values()),
            "reference": declared_reference(content["reference"], refuse),
            "controller": declared_controller(content["controller"], refuse),
        }
        if like is not None:
            return like.with_values(constants=constants, **parts)
        try:
            return ClosedLoop(system=system.with_constants(constants), **parts)
        except SettingError as error:
            raise refuse("observer", f"does not fit the model: {error.reason}") from None
        except (ModelError, ExpressionError) as error:
            raise refuse("controller", f"does not fit the model: {error}") from None


def frame_of(path: Path, tables: Mapping[str, Any]) -> tuple[Frame, dict[str, Any]]:
    """The frame of a file, and its tables checked."""
    refuse = partial(ExperimentError, str(path))
    kinds = _kinds(tables, refuse)
    content = checked(tables, kinds, refuse)
    system = declared_system(content["model"], path.parent, refuse)
    return Frame(str(path), kinds, system), content


def checked(tables: Mapping[str, Any], kinds: Kinds, refuse: Refuse) -> dict[str, Any]:
    """The tables as the schema of these kinds has them: keys, types and ranges are right."""
    return validated(tables, _schema(kinds), refuse).model_dump()


def _kinds(tables: Mapping[str, Any], refuse: Refuse) -> Kinds:
    from flexid.experiments import schema

    model = tables.get("model")
    return Kinds(
        not (isinstance(model, dict) and "file" in model),
        _chosen(tables, "controller", "law", schema.LAWS, refuse),
        _chosen(tables, "reference", "kind", schema.REFERENCES, refuse),
        "sampling" in tables,
    )


def _chosen(
    tables: Mapping[str, Any], table: str, key: str, choices: Mapping[str, Any], refuse: Refuse
) -> str:
    content = tables.get(table)
    if not isinstance(content, dict):
        raise refuse(table, "is missing: add the table" if content is None else "is no table")
    name = content.get(key)
    if not isinstance(name, str) or name not in choices:
        raise refuse(f"{table}.{key}", f"must be one of {', '.join(choices)}: correct it")
    return name


@lru_cache(maxsize=32)
def _schema(kinds: Kinds) -> Any:
    """The schema for the kinds of model, law and reference that a file names."""
    from flexid.experiments import schema

    generic: Any = schema.Tables  # its parts are chosen at run time
    return generic[
        schema.JointModel if kinds.joint else schema.FileModel,
        schema.LAWS[kinds.law],
        schema.REFERENCES[kinds.reference],
        schema.SampledRun if kinds.sampled else schema.ContinuousRun,
    ]
