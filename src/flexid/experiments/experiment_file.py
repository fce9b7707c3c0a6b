"""Experiment files: TOML in, a checked `Experiment` out."""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from flexid.errors import ExperimentError, ExpressionError, ModelError, SettingError
from flexid.experiments.experiment import Experiment, RunSettings
from flexid.experiments.parts import (
    declared_controller,
    declared_reference,
    declared_system,
    estimate_values,
    plant_values,
)
from flexid.experiments.variation_file import read_variation
from flexid.models.parametric_system import ParametricSystem
from flexid.simulation.loop import ClosedLoop
from flexid.simulation.sampled import Sampling
from flexid.toml_file import Refuse, parse_toml, read_bytes, validated

MOST_SAMPLES = 10_000_000
"""Most samples of one run."""


def read_experiment(path: str | Path) -> Experiment:
    """Read an experiment file.

    Parameters
    ----------
    path : str or Path
        A TOML file with the tables ``plant``, ``controller``, ``reference``, ``observer`` and
        ``run``, and optionally ``model``, ``initial_estimates``, ``initial_state``, ``sampling``
        and ``campaign``.

    Returns
    -------
    Experiment

    Raises
    ------
    ExperimentError
        If the file cannot be read or used; the text names file, key and remedy.
    """
    path = Path(path)
    refuse = partial(ExperimentError, str(path))
    tables = parse_toml(read_bytes(path, "an experiment file in TOML", refuse), refuse)
    campaign = tables.pop("campaign", None)
    experiment = _Builder(path, tables)(tables)
    if campaign is None:
        return experiment
    return replace(experiment, variation=read_variation(campaign, experiment))


class _Builder:
    """Makes experiments of tables; what only the names in them decide is made once."""

    def __init__(
        self,
        path: Path,
        tables: Mapping[str, Any],
        system: ParametricSystem | None = None,
        loop: ClosedLoop | None = None,
    ) -> None:
        self._path = path
        self._tables = tables
        self._refuse = partial(ExperimentError, str(path))
        self._schema = _schema(tables, self._refuse)
        model = validated(tables, self._schema, self._refuse).model_dump()["model"]
        self._system = system or declared_system(model, path.parent, self._refuse)
        self._joint = "file" not in model
        self._states = self._system.states
        self._coefficients = self._system.coefficients
        needed = model["known"] if self._joint else self._system.constants
        self._names = (*self._coefficients, *needed)
        self._loop = loop

    def __reduce__(self) -> tuple[type, tuple[Any, ...]]:
        # To another machine: the schema is made anew there, the model's file is not looked for
        return type(self), (self._path, self._tables, self._system, self._loop)

    def __call__(self, tables: Mapping[str, Any]) -> Experiment:
        content = validated(tables, self._schema, self._refuse).model_dump()
        self._complete(content)
        run, sampling = content["run"], content["sampling"]
        if sampling is None:
            del content["sampling"]
            if run["absolute_tolerance"] is None:
                run = {**run, "absolute_tolerance": 1e-3 * run["relative_tolerance"]}
            settings = RunSettings(**run)
        else:
            settings = RunSettings(run["duration"], sampling["sample_time"])
        self._check_length(settings)
        return Experiment(
            str(self._path),
            content,
            self._loop_of(content),
            settings,
            None if sampling is None else Sampling(**sampling),
            None,
            self,
        )

    def _complete(self, content: dict[str, Any]) -> None:
        """Write down what the file leaves to the model: constants, and zeros at the start."""
        state, states = content["initial_state"], self._states
        for name in state:
            if name not in states:
                raise self._refuse(
                    f"initial_state.{name}", f"is unknown: the states are {', '.join(states)}"
                )
        content["initial_state"] = {name: state.get(name, 0.0) for name in states}
        if not self._joint:
            content["plant"] = {**self._system.constants, **content["plant"]}
        if all(name in self._coefficients for name in content["initial_estimates"]):
            zeros = dict.fromkeys(self._coefficients, 0.0)
            content["initial_estimates"] = zeros | content["initial_estimates"]

    def _check_length(self, settings: RunSettings) -> None:
        if settings.duration < settings.sample_time:
            raise self._refuse("run.duration", "is shorter than the sample time: lengthen it")
        if settings.duration > MOST_SAMPLES * settings.sample_time:
            raise self._refuse(
                "run.duration", f"makes more than {MOST_SAMPLES} samples: shorten it"
            )

    def _loop_of(self, content: Mapping[str, Any]) -> ClosedLoop:
        system, refuse = self._system, self._refuse
        values = plant_values(content["plant"], self._names, self._joint, refuse)
        constants = {name: values[name] for name in system.constants if name in values}
        if self._joint and "coulomb_velocity" in system.constants:
            constants["coulomb_velocity"] = content["model"]["coulomb_velocity"]
        parts = {
            "coefficients": {name: values[name] for name in self._coefficients},
            "observer_gains": content["observer"],
            "initial_estimates": estimate_values(
                content["initial_estimates"], self._coefficients, self._names, self._joint, refuse
            ),
            "initial_state": tuple(content["initial_state"].values()),
            "reference": declared_reference(content["reference"], refuse),
        }
        controller = declared_controller(content["controller"], refuse)
        if self._loop is None:
            self._loop = self._first_loop(
                system=system.with_constants(constants), controller=controller, **parts
            )
            return self._loop
        return self._loop.with_values(constants=constants, controller=controller, **parts)

    def _first_loop(self, **parts: Any) -> ClosedLoop:
        try:
            return ClosedLoop(**parts)
        except SettingError as error:
            raise self._refuse("observer", f"does not fit the model: {error.reason}") from None
        except ModelError as error:
            raise self._refuse("controller", f"does not fit the model: {error}") from None
        except ExpressionError as error:
            raise self._refuse("controller", f"does not fit the model: {error}") from None


def _schema(tables: Mapping[str, Any], refuse: Refuse) -> Any:
    """The schema for the kinds of model, law and reference that the file names."""
    from flexid.experiments import schema

    model = tables.get("model")
    generic: Any = schema.Tables  # its parts are chosen at run time
    return generic[
        schema.FileModel if isinstance(model, dict) and "file" in model else schema.JointModel,
        _chosen(tables, "controller", "law", schema.LAWS, refuse),
        _chosen(tables, "reference", "kind", schema.REFERENCES, refuse),
        schema.SampledRun if "sampling" in tables else schema.ContinuousRun,
    ]


def _chosen(
    tables: Mapping[str, Any], table: str, key: str, choices: Mapping[str, Any], refuse: Refuse
) -> Any:
    content = tables.get(table)
    if not isinstance(content, dict):
        raise refuse(table, "is missing: add the table" if content is None else "is no table")
    name = content.get(key)
    if not isinstance(name, str) or name not in choices:
        raise refuse(f"{table}.{key}", f"must be one of {', '.join(choices)}: correct it")
    return choices[name]
