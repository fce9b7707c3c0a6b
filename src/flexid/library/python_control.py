"""Other simulators: systems of python-control, and logs of joints that MuJoCo simulates.

The package python-control (the extra ``control``) is not `flexid.control`, which declares
controllers. Each function returns a ``control.NonlinearIOSystem``, whose signals have the names
that the declaration gives them, so that ``control.interconnect`` joins them by name.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from flexid.arrays import FloatArray
from flexid.control.laws import REFERENCE_NAMES, Controller
from flexid.control.references import Multisine
from flexid.errors import ArgumentError, SettingError
from flexid.estimators.online import OnlineEstimator
from flexid.exports import mujoco_log as mujoco
from flexid.kernels.store import load_kernel
from flexid.library.arguments import entrance, kind_of
from flexid.models.parametric_system import ParametricSystem
from flexid.simulation.closed_loop import ClosedLoop, check_values
from flexid.simulation.sampled import plain_model

if TYPE_CHECKING:
    from control import InterconnectedSystem, NonlinearIOSystem

    from flexid.library.arguments import FilePath
    from flexid.library.joint_estimate import JointEstimate
    from flexid.library.simulate import SimulatedRun


def python_control() -> Any:
    """The package python-control."""
    try:
        import control
    except ImportError:
        raise SettingError(
            "python-control", "is not installed: pip install 'flexid[control]'"
        ) from None
    return control


@entrance
def plant_io_system(
    model: JointEstimate | ParametricSystem | FilePath,
    coefficients: Mapping[str, float] | None = None,
    *,
    name: str = "plant",
) -> NonlinearIOSystem:
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
    """
    from flexid.exports.request import ExportRequest
    from flexid.library.export import what_is_meant

    meant = what_is_meant(model)
    assert isinstance(meant, ExportRequest)  # no arm
    return _plant(meant.system, {**meant.values, **(coefficients or {})}, name)


def _plant(
    system: ParametricSystem, coefficients: Mapping[str, float], name: str = "plant"
) -> NonlinearIOSystem:
    """A model as a continuous system whose output is its state."""
    control = python_control()
    params = _complete("coefficients", coefficients, system.coefficients)
    model, count = plain_model(system), len(system.states)

    def update(_t: float, x: Any, u: Any, given: Mapping[str, float]) -> FloatArray:
        rates = np.empty(count)
        p = np.array([given[c] for c in system.coefficients], dtype=np.float64)
        c = np.array([given[c] for c in system.constants], dtype=np.float64)
        with np.errstate(all="ignore"):
            model.right_hand_side(_vector(x), _vector(u), p, c, rates)
        return rates

    return control.nlsys(
        update,
        lambda _t, x, _u, _params: x,
        inputs=list(system.inputs),
        outputs=list(system.states),
        states=list(system.states),
        params={**params, **system.constants},
        name=name,
    )


@entrance
def controller_io_system(
    controller: Controller, system: ParametricSystem, *, name: str = "controller"
) -> NonlinearIOSystem:
    """A controller as a static system of python-control.

    Parameters
    ----------
    controller : Controller
        As those of ``flexid.control``; its parameters are the system's ``params``.
    system : ParametricSystem
        The model that it controls.
    name : str, optional
        Of the system.

    Returns
    -------
    control.NonlinearIOSystem
        From the model's states, then ``qd``, ``qd_1``, ... as far as the law uses them, to the
        model's inputs.
    """
    control = python_control()

    def build() -> str:
        from flexid.derivation.printing_code import law_module

        return law_module(controller, system)

    module = load_kernel("control_law", (controller.digest, system.digest), build)
    states = len(system.states)
    names = (*controller.parameters, *system.constants)

    @lru_cache(maxsize=8)
    def values(*given: float) -> list[float]:
        """What the law takes, with the parameters that follow from others."""
        by_name = dict(zip(names, given, strict=True))
        own = {name: by_name[name] for name in controller.parameters}
        by_name |= controller.with_parameters(**own).values
        return [by_name[name] for name in module.VALUES]

    def output(_t: float, _x: Any, u: Any, given: Mapping[str, float]) -> FloatArray:
        signals = _vector(u).tolist()
        ordered = values(*(given[name] for name in names))
        return np.array(module.law(signals[:states], signals[states:], ordered))

    return control.nlsys(
        None,
        output,
        inputs=[*system.states, *module.REFERENCE],
        outputs=list(system.inputs),
        params={**controller.parameters, **system.constants},
        name=name,
    )


def signal(
    reference: Multisine, names: Iterable[str] = ("qd",), name: str = "reference"
) -> NonlinearIOSystem:
    """A reference with its derivatives as a source: a system without inputs."""
    control = python_control()
    wanted = list(names)
    orders = [REFERENCE_NAMES.index(one) for one in wanted]

    def output(t: float, _x: Any, _u: Any, _params: object) -> FloatArray:
        return np.array([float(reference.evaluate(t, order)) for order in orders])

    return control.nlsys(None, output, inputs=[], outputs=wanted, name=name)


@entrance
def observer_io_system(
    system: ParametricSystem, gains: Mapping[str, float], *, name: str = "observer"
) -> NonlinearIOSystem:
    """The parametric observer of Huang (2003), eqs. (2) and (3), as a system of python-control.

    Parameters
    ----------
    system : ParametricSystem
        The model whose coefficients it estimates.
    gains : mapping of str to float
        The gain of each row, by the row's name.
    name : str, optional
        Of the system.

    Returns
    -------
    control.NonlinearIOSystem
        In continuous time, from the model's states and inputs to an estimate of each coefficient,
        ``theta1_hat`` and so on.
    """
    control = python_control()
    module = _observer_module(system)
    rows = tuple(row.name for row in system.rows)
    ordered = tuple(_complete("gains", gains, rows).values())
    states, constants = len(system.states), tuple(system.constants)

    def arguments(x: Any, u: Any, given: Mapping[str, float]) -> list[list[float]]:
        signals = _vector(u).tolist()
        values = [given[c] for c in constants]
        groups = [signals[:states], signals[states:], _vector(x).tolist(), list(ordered), values]
        return [group for group in groups if group]

    return control.nlsys(
        lambda _t, x, u, given: np.array(module.rates(*arguments(x, u, given))),
        lambda _t, x, u, given: np.array(module.estimates(*arguments(x, u, given))),
        inputs=[*system.states, *system.inputs],
        outputs=[f"{c}_hat" for c in system.coefficients],
        states=list(module.OWN_STATES),
        params=dict(system.constants),
        name=name,
    )


def observer_start(
    system: ParametricSystem,
    gains: Mapping[str, float],
    estimates: Mapping[str, float],
    state: Iterable[float],
) -> FloatArray:
    """State of an observer that begins with some estimates: y = p̂ - c b(x), from eq. (2)."""
    module = _observer_module(system)
    rows = tuple(row.name for row in system.rows)
    ordered = list(_complete("gains", gains, rows).values())
    nothing = [0.0] * len(system.coefficients)
    groups = (list(state), [0.0] * len(system.inputs), nothing, ordered)
    constants = list(system.constants.values())
    offset = module.estimates(*(group for group in (*groups, constants) if group))
    return np.array([estimates.get(c, 0.0) for c in system.coefficients]) - np.array(offset)


def _observer_module(system: ParametricSystem) -> Any:
    def build() -> str:
        from flexid.derivation.printing_code import observer_module

        return observer_module(system)

    return load_kernel("continuous_observer", (system.digest,), build)


@entrance
def estimator_io_system(
    estimator: OnlineEstimator, *, name: str = "estimator"
) -> NonlinearIOSystem:
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
    """
    if not isinstance(estimator, OnlineEstimator):
        raise ArgumentError(
            "estimator_io_system",
            "estimator",
            f"is {kind_of(estimator)}: give what flexid.recursive_least_squares or another returns",
        )
    control = python_control()
    system = estimator.system
    measured = system.states if estimator.needs_velocities else system.states[::2]
    return control.nlsys(
        lambda _t, x, u, _params: estimator.step(_vector(x), _vector(u))[0],
        lambda _t, x, _u, _params: estimator.coefficients(_vector(x)),
        inputs=[*measured, *system.inputs],
        outputs=[f"{c}_hat" for c in system.coefficients],
        states=len(estimator.init()),
        dt=estimator.sample_time,
        name=name,
    )


@dataclass(frozen=True, eq=False)
class LoopSystem:
    """A closed loop for python-control."""

    system: InterconnectedSystem  # parts joined by name; it has no inputs
    start: FloatArray  # its state at the start


@entrance
def loop_io_system(experiment: SimulatedRun | FilePath) -> LoopSystem:
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
    """
    from flexid.experiments import read_experiment
    from flexid.library.simulate import SimulatedRun

    if isinstance(experiment, SimulatedRun):
        return _closed_loop(experiment.experiment.loop)
    return _closed_loop(read_experiment(Path(experiment)).loop)


def _closed_loop(loop: ClosedLoop) -> LoopSystem:
    """A closed loop of plant, controller, reference and observer."""
    control = python_control()
    model = loop.system
    plays = controller_io_system(loop.controller, model)
    follows = [label for label in plays.input_labels if label in REFERENCE_NAMES]
    parts = [
        signal(loop.reference, follows or ("qd",)),
        plays,
        _plant(model, loop.coefficients),
        observer_io_system(model, loop.observer_gains),
    ]
    estimates = [f"{c}_hat" for c in model.coefficients]
    system = control.interconnect(
        parts,
        inputs=[],
        outputs=[*model.states, *model.inputs, *estimates, *(follows or ("qd",))],
        name="loop",
    )
    own = observer_start(model, loop.observer_gains, loop.initial_estimates, loop.initial_state)
    return LoopSystem(system, np.concatenate((np.array(loop.initial_state), own)))


def _complete(
    setting: str, values: Mapping[str, float], names: tuple[str, ...]
) -> dict[str, float]:
    """A value for each name, in order."""
    check_values(setting, values, names)
    return {name: float(values[name]) for name in names}


def _vector(values: Any) -> NDArray[np.float64]:
    return np.ascontiguousarray(values, dtype=np.float64).reshape(-1)


mujoco_log = entrance(mujoco.mujoco_log)
