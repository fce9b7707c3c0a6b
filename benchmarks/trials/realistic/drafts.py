"""A realistic drive before the size of its motion is known, and the truth of its log."""

from dataclasses import dataclass, field

import numpy as np

from benchmarks.trials.realistic.drive import Plant, warmth_at

_WIDTH = 2e-3  # rad/s, of the smooth change of the friction's sign, where the step resolves it
_RESOLVED = 2.5e-4  # s, shortest time in which that friction stops the motor


@dataclass(frozen=True)
class Sensor:
    """How an angle is read.

    Parameters
    ----------
    bits : float
        Of an encoder over a turn, or of a converter over its range.
    range : float
        Range of a converter as a multiple of the motion's; zero for an encoder.
    noise : float
        Standard deviation of white noise, in steps.
    """

    bits: float
    range: float = 0.0
    noise: float = 0.0

    def step(self, reach: float) -> float:
        """Step in rad, of angles up to `reach` to either side."""
        turn = 2.0 * self.range * reach if self.range else 2.0 * np.pi
        return turn / 2.0**self.bits


@dataclass
class Draft:
    """What a family draws before the size of the motion is known.

    Parameters
    ----------
    plant : Plant
        What is absolute.
    resonance, pace, duration : float
        Resonance of link against motor in rad/s, samples per second, length in s.
    motion : {"multisine", "binary", "square", "tracking", "moves"}
    target : float
        Half the range through which the motor is to move, in rad.
    link, motor : Sensor
    shares : dict of str to float
        Fields of the plant, and `link_push` and `motor_push`, as shares of the torque's root mean
        square; `dead_zone` and `saturation` as shares of its peak; `cable` as a share of the
        spring's torque.
    push_time : float
        Correlation time of the disturbing torques in s.
    dither : float
        Root mean square of what is added to a controller's torque, as a share of the whole.
    highest : float
        Frequency of the fastest tone of a multisine, as a share of the resonance.
    largest : float
        Largest deflection in rad, root mean square.
    held : bool
        Whether the controller runs at the log's rate; otherwise at 500 per second or more.
    volts : float
        Peak of the voltage that is logged; zero where a torque is logged.
    has_gauge : bool
        Whether the deflection is logged in place of the link.
    gauge_scale, gauge_drift : float
        What the gauge shows for one rad; its drift as a share of the deflection's range.
    eccentricity : float
        Error of the link's encoder, once per turn, as a share of the deflection's root mean square.
    dropped, jitter : float
        Share of samples that are lost; early or late sampling as a share of the sample time.
    sins : dict
        What was drawn, by name.
    """

    plant: Plant
    resonance: float
    pace: float
    duration: float
    motion: str
    target: float
    link: Sensor = Sensor(14)
    motor: Sensor = Sensor(14)
    shares: dict[str, float] = field(default_factory=dict)
    push_time: float = 0.1
    dither: float = 0.0
    highest: float = 1.0
    largest: float = 0.12
    held: bool = True
    volts: float = 0.0
    has_gauge: bool = False
    gauge_scale: float = 1.0
    gauge_drift: float = 0.0
    eccentricity: float = 0.0
    dropped: float = 0.0
    jitter: float = 0.0
    sins: dict[str, float] = field(default_factory=dict)

    @property
    def is_controlled(self) -> bool:
        """Whether a controller follows a reference; otherwise it holds the middle, gently."""
        return self.motion in ("tracking", "moves")

    def change(self, **fields: float) -> None:
        """Change fields of the plant."""
        self.plant = self.plant._replace(**fields)


@dataclass(frozen=True)
class Size:
    """Size of a motion.

    Parameters
    ----------
    torque, peak : float
        Root mean square and peak of the input in N m.
    spring : float
        Root mean square of the spring's torque.
    link, motor, gauge : float
        Largest angle of link and motor, and reading of the gauge, to either side in rad.
    half_range : float
        Half the range of the motor in rad.
    """

    torque: float
    peak: float
    spring: float
    link: float
    motor: float
    gauge: float
    half_range: float


def realised(draft: Draft, size: Size) -> Plant:
    """The plant for a size of its motion."""
    shares = draft.shares
    fields = {
        name: shares[name] * size.torque
        for name in ("coulomb", "static_extra", "ripple", "ripple_second")
        if name in shares
    }
    dry = fields.get("coulomb", 0.0) + fields.get("static_extra", 0.0)
    fields["friction_width"] = max(_WIDTH, _RESOLVED * dry / draft.plant.motor_inertia)
    if "dead_zone" in shares:
        fields["dead_zone"] = shares["dead_zone"] * size.peak
    if "saturation" in shares:
        fields["saturation"] = shares["saturation"] * size.peak
    if "cable" in shares:
        pull = shares["cable"] * size.spring / draft.target
        fields["cable_stiffness"], fields["cable_cubic"] = pull, 0.5 * pull / draft.target**2
    return draft.plant._replace(**fields)


def sensor_steps(draft: Draft, size: Size) -> tuple[float, float]:
    """Steps of the link's (or the gauge's) and the motor's sensor in rad."""
    return (
        draft.link.step(size.gauge if draft.has_gauge else size.link),
        draft.motor.step(size.motor),
    )


def truth_of(draft: Draft, plant: Plant, gain: float) -> tuple[dict[str, float], tuple[str, ...]]:
    """Low-frequency parameters of what is logged, and which of them are core.

    Parameters
    ----------
    draft : Draft
    plant : Plant
    gain : float
        Torque in N m for one unit of the input that is logged.
    """
    times = np.linspace(0.0, draft.duration, 1001)
    warm = float(np.mean([warmth_at.py_func(plant, time) for time in times]))
    if draft.volts:
        return _ratios(draft, plant, warm, gain)
    values = {
        "link_inertia": plant.near_inertia + plant.tip_inertia,
        "motor_inertia": plant.motor_inertia,
        "joint_stiffness": plant.joint_stiffness,
        "motor_viscous_friction": warm * plant.motor_viscous,
        "motor_coulomb_friction": warm * plant.coulomb,
        "link_viscous_friction": plant.link_viscous,
        "link_coulomb_friction": 0.0,
        "joint_damping": plant.joint_damping,
    }
    if plant.gravity_torque or not plant.cable_stiffness:
        values["gravity_torque"] = plant.gravity_torque
    return values, ("link_inertia", "motor_inertia", "joint_stiffness")


def _ratios(
    draft: Draft, plant: Plant, warm: float, gain: float
) -> tuple[dict[str, float], tuple[str, ...]]:
    """What a log without a torque shows; a gauge that reads too much makes its spring softer."""
    link, motor = plant.near_inertia + plant.tip_inertia, plant.motor_inertia
    stiffness = plant.joint_stiffness / draft.gauge_scale
    viscous = warm * plant.motor_viscous + plant.back_emf
    values = {
        "joint_stiffness_per_link_inertia": stiffness / link,
        "joint_stiffness_per_motor_inertia": stiffness / motor,
        "link_inertia_per_motor_inertia": link / motor,
        "viscous_friction_per_motor_inertia": viscous / motor,
        "gravity_torque_per_link_inertia": plant.gravity_torque / link,
        "gravity_torque_per_motor_inertia": plant.gravity_torque / motor,
    }
    if not plant.dead_zone:
        values["coulomb_friction_per_motor_inertia"] = warm * plant.coulomb / motor
    if not plant.dead_zone or draft.motion not in ("square", "binary"):
        values["input_gain_per_motor_inertia"] = gain / motor
    if not draft.has_gauge:
        values["viscous_friction_per_link_inertia"] = plant.link_viscous / link
        values["coulomb_friction_per_link_inertia"] = 0.0
        values["joint_damping_per_motor_inertia"] = plant.joint_damping / motor
    return values, (
        "joint_stiffness_per_link_inertia",
        "joint_stiffness_per_motor_inertia",
        "link_inertia_per_motor_inertia",
    )
