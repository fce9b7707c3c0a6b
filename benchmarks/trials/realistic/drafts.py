"""Draft of a realistic drive before the size of its motion is known, and truth of its log."""

from dataclasses import dataclass, field

import numpy as np

from benchmarks.trials.realistic.drive import Plant, warmth_at

_WIDTH = 2e-3  # rad/s, width of the friction's smooth sign, if the step resolves it
_RESOLVED = 2.5e-4  # s, shortest time in which friction stops the motor


@dataclass(frozen=True)
class Sensor:
    """Sensor of an angle.

    Parameters
    ----------
    bits : float
        Bits of an encoder per turn, or of a converter over its range.
    range : float
        Range of a converter as a multiple of the motion's; zero for an encoder.
    noise : float
        Standard deviation of white noise, in steps.
    """

    bits: float
    range: float = 0.0
    noise: float = 0.0

    def step(self, reach: float) -> float:
        """Return the step in rad for angles up to `reach` to either side."""
        turn = 2.0 * self.range * reach if self.range else 2.0 * np.pi
        return turn / 2.0**self.bits


@dataclass
class Draft:
    """Random draft of a family, before the size of the motion is known.

    Parameters
    ----------
    plant : Plant
        Absolute values.
    resonance, pace, duration : float
        Resonance of link against motor in rad/s, samples per second, length in s.
    motion : {"multisine", "binary", "square", "tracking", "moves"}
    target : float
        Half the desired range of the motor, in rad.
    link, motor : Sensor
    shares : dict of str to float
        Fields of the plant, and `link_push` and `motor_push`, over the torque's root mean square;
        `dead_zone` and `saturation` over its peak; `cable` over the spring's torque.
    push_time : float
        Correlation time of the disturbing torques in s.
    dither : float
        Root mean square of a torque added to the controller's, over the whole.
    highest : float
        Highest frequency of a multisine, over the resonance.
    largest : float
        Largest deflection in rad, root mean square.
    held : bool
        Whether the controller runs at the log's rate; otherwise at 500 1/s or more.
    volts : float
        Peak of the logged voltage; zero if a torque is logged.
    has_gauge : bool
        Whether the deflection is logged instead of the link.
    gauge_scale, gauge_drift : float
        Reading of the gauge for one rad; its drift over the deflection's range.
    eccentricity : float
        Error of the link's encoder, once per turn, over the deflection's root mean square.
    dropped, jitter : float
        Share of lost samples; jitter of the sampling over the sample time.
    sins : dict
        Imperfections by name.
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
        """Whether a controller follows a reference; otherwise it only centres the motion weakly."""
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
        Largest angle of link and motor, and largest reading of the gauge, in rad.
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
    """Return the plant for a size of the motion."""
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
    """Return the steps of the link's (or the gauge's) and the motor's sensor in rad."""
    return (
        draft.link.step(size.gauge if draft.has_gauge else size.link),
        draft.motor.step(size.motor),
    )


def truth_of(draft: Draft, plant: Plant, gain: float) -> tuple[dict[str, float], tuple[str, ...]]:
    """Return the low-frequency parameters of the logged channels, and the names of core ones.

    Parameters
    ----------
    draft : Draft
    plant : Plant
    gain : float
        Torque in N m per unit of the logged input.
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
    """Return the ratios that a log without torque determines; a gauge's scale divides stiffness."""
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
