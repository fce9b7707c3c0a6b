"""A joint that MuJoCo simulates, as a recording to identify."""

# MuJoCo's compiled half has no type stubs, so pyright cannot see what it exports.
# pyright: reportAttributeAccessIssue=false

from os import PathLike
from pathlib import Path
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


def mujoco_log(
    model: "Model",
    torque: FloatArray,
    sample_time: float,
    *,
    hold: Hold = "zero",
    link: str | None = "link",
    motor: str = "motor",
    actuator: str = "motor",
    positions: tuple[float, float] = (0.0, 0.0),
    velocities: tuple[float, float] = (0.0, 0.0),
) -> Recording:
    """Play a torque to a MuJoCo scene and record what its encoders read.

    Parameters
    ----------
    model : path or mujoco.MjModel
        The scene. A sample must be a whole number of its steps.
    torque : array, shape (n,)
        Values of the actuator's input, one per sample; before the first it was constant, which
        matters where the actuator has a delay.
    sample_time : float
        Time between samples in s.
    hold : {"zero", "linear", "cubic"}, optional
        What the torque does between samples. The engine holds it over each of its steps.
    link, motor, actuator : str, optional
        Names of the two hinges and of the actuator; link None where there is one hinge.
    positions, velocities : tuple of float, optional
        Where link and motor begin, in rad and rad/s; all else begins as the scene has it.

    Returns
    -------
    Recording
        Positions at the beginning of each sample, without noise, and the torque.

    Raises
    ------
    SettingError
        If MuJoCo is not installed, the scene cannot be loaded, or something is not in it.
    SimulationError
        If the motion diverges.
    """
    engine = _engine()
    scene, name = _loaded(engine, model)
    inputs = np.asarray(torque, dtype=np.float64)
    if inputs.ndim != 1 or len(inputs) == 0 or not np.all(np.isfinite(inputs)):
        raise SettingError("torque", "must be a list of finite numbers: give one for each sample")
    steps = _steps(sample_time, scene.opt.timestep)
    hinges = [(_place(engine, scene, "joint", motor), positions[1], velocities[1])]
    if link is not None:
        hinges.insert(0, (_place(engine, scene, "joint", link), positions[0], velocities[0]))
    played = _place(engine, scene, "actuator", actuator)
    state = engine.MjData(scene)
    places = scene.jnt_qposadr[[joint for joint, _, _ in hinges]]
    for place, (joint, position, velocity) in zip(places, hinges, strict=True):
        state.qpos[place] = position
        state.qvel[scene.jnt_dofadr[joint]] = velocity
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
    return Recording(
        sample_time,
        0.0,
        None if link is None else angles[:, 0].copy(),
        angles[:, -1].copy(),
        inputs,
        "N m",
        source=name,
    )


def _engine() -> Any:
    try:
        import mujoco
    except ImportError:
        raise SettingError("mujoco_log", "needs MuJoCo: pip install 'flexid[mujoco]'") from None
    return mujoco


def _loaded(engine: Any, model: "Model") -> tuple[Any, str]:
    """The scene, and a name for what it moves."""
    if isinstance(model, engine.MjModel):
        return model, "MuJoCo scene"
    path = Path(model)
    if not path.is_file():
        raise SettingError("model", f"{path}: there is no such file: give a scene in MuJoCo's XML")
    try:
        return engine.MjModel.from_xml_path(str(path)), str(path)
    except ValueError as error:
        reason = " ".join(str(error).split())
        raise SettingError("model", f"{path}: MuJoCo cannot load it: {reason}") from None


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


def _place(engine: Any, scene: Any, kind: str, name: str) -> int:
    """Number of a hinge or an actuator."""
    of_kind = {"joint": engine.mjtObj.mjOBJ_JOINT, "actuator": engine.mjtObj.mjOBJ_ACTUATOR}
    found = engine.mj_name2id(scene, of_kind[kind], name)
    if found < 0:
        count = scene.njnt if kind == "joint" else scene.nu
        names = [engine.mj_id2name(scene, of_kind[kind], i) or f"number {i}" for i in range(count)]
        raise SettingError(
            kind, f"{name!r} is not in the scene, which has {', '.join(names) or 'none'}"
        )
    return found


def _diverged(engine: Any, state: Any) -> bool:
    """Whether the engine has reset the motion, or ignored a torque that it finds too large."""
    bad = ("BADQPOS", "BADQVEL", "BADQACC", "BADCTRL")
    kinds = [getattr(engine.mjtWarning, f"mjWARN_{kind}") for kind in bad]
    return any(state.warning[int(kind)].number for kind in kinds)
