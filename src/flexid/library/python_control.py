"""Other simulators: systems of python-control, and logs of joints that MuJoCo simulates."""

from collections.abc import Mapping
from os import PathLike
from typing import TYPE_CHECKING

from flexid.errors import ArgumentError
from flexid.exports import mujoco_log as mujoco
from flexid.exports import python_control as worker
from flexid.library.arguments import as_mapping, as_path, entrance, kind_of

if TYPE_CHECKING:
    from control import NonlinearIOSystem

    from flexid.estimators.online import OnlineEstimator
    from flexid.exports.python_control import LoopSystem
    from flexid.library.joint_estimate import JointEstimate
    from flexid.library.simulate import SimulatedRun
    from flexid.models.parametric_system import ParametricSystem


controller_io_system = entrance(worker.controller_io_system)
observer_io_system = entrance(worker.observer_io_system)


@entrance
def plant_io_system(
    model: "JointEstimate | ParametricSystem | str | PathLike[str]",
    coefficients: Mapping[str, float] | None = None,
    *,
    name: str = "plant",
) -> "NonlinearIOSystem":
    """What was identified, or a model, as a system of python-control.

    Parameters
    ----------
    model : JointEstimate, ParametricSystem or path
        What `flexid.identify` returned, an ``estimate.json``, a model or a TOML model file. Coulomb
        friction is smoothed over the constant ``coulomb_velocity``.
    coefficients : mapping of str to float, optional
        A value for each coefficient; of an estimate, those that are to be others.
    name : str, optional
        Of the system.

    Returns
    -------
    control.NonlinearIOSystem
        In continuous time, from the model's inputs to its states, with its coefficients and
        constants as ``params``.

    Raises
    ------
    SettingError
        If python-control is not installed, or a coefficient has no value or is unknown.
    ModelError
        If the model file cannot be used.
    ArgumentError
        If an option is unknown or of a wrong type.
    """
    from flexid.library.export import export_source

    source = export_source(model)
    given = as_mapping("plant_io_system", "coefficients", coefficients, "{'theta2': 100.0}")
    return worker.plant(source.system, {**source.values, **given}, name)


@entrance
def estimator_io_system(
    estimator: "OnlineEstimator", *, name: str = "estimator"
) -> "NonlinearIOSystem":
    """An online estimator as a system of python-control, in discrete time.

    Parameters
    ----------
    estimator : online estimator
        As `flexid.recursive_least_squares` and the others make it.
    name : str, optional
        Of the system.

    Returns
    -------
    control.NonlinearIOSystem
        From a sample, as the estimator's ``pack`` makes it, to the estimates before that sample,
        ``theta1_hat`` and so on. Its first state is ``estimator.init()``.

    Raises
    ------
    SettingError
        If python-control is not installed.
    ArgumentError
        If an option is unknown or of a wrong type.
    """
    from flexid.estimators.online import OnlineEstimator

    if not isinstance(estimator, OnlineEstimator):
        raise ArgumentError(
            "estimator_io_system",
            "estimator",
            f"is {kind_of(estimator)}: give what flexid.recursive_least_squares or another returns",
        )
    return worker.estimator(estimator, name)


@entrance
def loop_io_system(experiment: "SimulatedRun | str | PathLike[str]") -> "LoopSystem":
    """The closed loop of an experiment file as a system of python-control, in continuous time.

    Parameters
    ----------
    experiment : SimulatedRun or path
        What `flexid.simulate` returned, or a TOML file. Of a sampled experiment sample time, limits
        and sensors are left out.

    Returns
    -------
    LoopSystem
        ``system``, in which reference, controller, plant and observer are joined by name, and
        ``start``, its state at the start.

    Raises
    ------
    SettingError
        If python-control is not installed.
    ExperimentError
        If the file cannot be used.
    AccelerationError, ModelError
        If the observer has no continuous form.
    ArgumentError
        If an option is unknown or of a wrong type.
    """
    from flexid.experiments import read_experiment
    from flexid.library.simulate import SimulatedRun

    if isinstance(experiment, SimulatedRun):
        return worker.closed_loop(experiment.experiment.loop)
    path = as_path("loop_io_system", "experiment", experiment)
    return worker.closed_loop(read_experiment(path).loop)


mujoco_log = entrance(mujoco.mujoco_log)
