"""A joint that MuJoCo simulates, as a recording to identify."""

# MuJoCo's compiled half has no type stubs, so pyright cannot see what it exports.
# pyright: reportAttributeAccessIssue=false

from os import PathLike, fspath
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from flexid.arrays import FloatArray
from flexid.errors import SettingError, SimulationError
from flexid.estimators.channel_timing import held_input
from flexid.recording.recording import Hold, Recording

if TYPE_CHECKING:
    import mujoco

    Model: TypeAlias = str | PathLike[str] | mujoco.MjModel
    """A scene: its file, or as MuJoCo has loaded it."""

_SAME_STEP = 1e-6  # of a step, by which a sample may miss being a whole number of them
_LINK, _MOTOR = "link", "motor"  # names of the hinges; of the actuator as well


def mujoco_log(
    model: "Model", torque: FloatArray, sample_time: float, *, hold: Hold = "zero"
) -> Recording:
    """Play a torque to a MuJoCo scene and record what its encoders read.

    Parameters
    ----------
    model : path or mujoco.MjModel
        A scene as `flexid.export` writes it: a hinge and an actuator called motor, and a hinge
        called link if there is one. It begins at rest. A sample must be a whole number of its
        steps.
    torque : array, shape (n,)
        Values of the actuator's input, one per sample; before the first it was constant, which
        matters where the actuator has a delay.
    sample_time : float
        Time between samples in s.
    hold : {"zero", "linear", "cubic"}, optional
        What the torque does between samples. The engine holds it over each of its steps.

    Returns
    -------
    Recording
        Positions at the beginning of each sample, without noise, and the torque.

    Raises
    ------
    SettingError
        If MuJoCo is not installed, or the scene or the torque cannot be played.
    SimulationError
        If the motion diverges.
    """
    try:
        import mujoco as engine
    except ImportError:
        raise SettingError("mujoco_log", "needs MuJoCo: pip install 'flexid[mujoco]'") from None
    scene, name = (model, "scene") if isinstance(model, engine.MjModel) else _loaded(engine, model)
    hinges, played = _parts(engine, scene, name)
    inputs = np.asarray(torque, dtype=np.float64)
    if inputs.ndim != 1 or len(inputs) == 0 or not np.all(np.isfinite(inputs)):
        raise SettingError("torque", "must be a list of finite numbers: give one for each sample")
    steps = _steps(sample_time, scene.opt.timestep)
    state = engine.MjData(scene)
    places = scene.jnt_qposadr[hinges]
    if scene.actuator_delay[played] > 0.0:
        before = np.full(scene.actuator_history[played][0], inputs[0])
        engine.mj_initCtrlHistory(scene, state, played, None, before)
    lines = held_input(inputs[:, None], sample_time, hold, 0.0)[:, 0]
    middles = (np.arange(steps) + 0.5) / steps
    angles = np.empty((len(inputs), len(hinges)))
    for sample, (start, change, *_) in enumerate(lines):
        angles[sample] = state.qpos[places]
        for value in start + change * middles:
            state.ctrl[played] = value
            engine.mj_step(scene, state)
        if _diverged(engine, state):
            raise SimulationError(
                "the motion diverges: give the scene a shorter timestep, or less torque",
                sample * sample_time,
            )
    link = angles[:, 0].copy() if len(hinges) > 1 else None
    return Recording(sample_time, 0.0, link, angles[:, -1].copy(), inputs, "N m", source=name)


def _loaded(engine: Any, model: str | PathLike[str]) -> tuple[Any, str]:
    """The scene of a file, and the file's name."""
    name = fspath(model)
    try:
        return engine.MjModel.from_xml_path(name), name
    except ValueError as error:
        reason = " ".join(str(error).split())
        raise SettingError("model", f"{name}: MuJoCo cannot load it: {reason}") from None


def _parts(engine: Any, scene: Any, name: str) -> tuple[list[int], int]:
    """Numbers of the hinges, the link's first, and of the actuator."""
    link, motor, actuator = (
        engine.mj_name2id(scene, kind, part)
        for kind, part in (
            (engine.mjtObj.mjOBJ_JOINT, _LINK),
            (engine.mjtObj.mjOBJ_JOINT, _MOTOR),
            (engine.mjtObj.mjOBJ_ACTUATOR, _MOTOR),
        )
    )
    if motor < 0 or actuator < 0:
        raise SettingError("model", f"{name} needs a hinge and an actuator: call both motor")
    return [hinge for hinge in (link, motor) if hinge >= 0], actuator


def _steps(sample_time: float, timestep: float) -> int:
    """The engine's steps in a sample."""
    steps = sample_time / timestep if sample_time > 0.0 else 0.0
    if not np.isfinite(steps) or round(steps) < 1 or abs(steps - round(steps)) > _SAME_STEP:
        raise SettingError(
            "sample_time",
            f"{sample_time:g} s is not a multiple of the scene's step of {timestep:g} s: change "
            f"one of the two",
        )
    return round(steps)


def _diverged(engine: Any, state: Any) -> bool:
    """Whether the engine has reset the motion, or ignored a torque that it finds too large."""
    bad = ("BADQPOS", "BADQVEL", "BADQACC", "BADCTRL")
    kinds = [getattr(engine.mjtWarning, f"mjWARN_{kind}") for kind in bad]
    return any(state.warning[int(kind)].number for kind in kinds)
