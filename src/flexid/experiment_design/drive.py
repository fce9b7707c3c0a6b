"""Drive file of a design: assumed parameters, limits, sensors and the experiment."""

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from itertools import product
from math import isfinite, pi
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator
from scipy.optimize import root

from flexid.arrays import FloatArray
from flexid.errors import SimulationError
from flexid.estimators.channel_timing import Timing
from flexid.estimators.samples import Samples, divide
from flexid.estimators.segmented_motion import Point, SegmentedMotion, segmented_motion
from flexid.files import RefuseKey, parse_toml, read_small, validated
from flexid.kernels.store import model_kernel
from flexid.models.flexible_joint import COULOMB_VELOCITY, SHAPE_TERMS, flexible_joint
from flexid.models.motion import JointType
from flexid.models.parametric_system import ParametricSystem
from flexid.models.physical import TERM_PARAMETERS, joint_coefficients
from flexid.simulation.free_run import free_run
from flexid.stored_estimates.estimate_file import StoredEstimate, refusal

DOUBT = 0.3  # largest relative error of each assumed parameter

_RANDOM_CASES = 16
_RAMP = 0.1  # of the duration
_HIGHEST = 1.5  # frequency of the fastest tone, over the resonance


def _nonzero(value: float) -> float:
    if value == 0.0:
        raise ValueError("zero has no relative error: leave it out, or give a typical value")
    return value


Number = Annotated[float, Field(allow_inf_nan=False), AfterValidator(_nonzero)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


class Parameters(_Table):
    """Physical parameters in SI units; the model has no terms for those left out."""

    link_inertia: Positive
    motor_inertia: Positive
    joint_stiffness: Positive
    gravity_torque: Number | None = None
    motor_viscous_friction: Positive | None = None
    link_viscous_friction: Positive | None = None
    joint_damping: Positive | None = None
    motor_coulomb_friction: Positive | None = None
    link_coulomb_friction: Positive | None = None
    cubic_joint_stiffness: Number | None = None
    link_offset_torque: Number | None = None
    motor_offset_torque: Number | None = None


class Limits(_Table):
    """Largest allowed magnitudes; velocity and position apply to both link and motor."""

    torque: Positive
    velocity: Positive
    position: Positive
    deflection: Positive


class Sensors(_Table):
    """Noise of both encoders, in rad or m, or from bits per turn of the joint."""

    position_noise: Positive | None = None
    encoder_bits: Annotated[int, Field(ge=6, le=32)] | None = None

    @model_validator(mode="after")
    def _one_of_two(self) -> "Sensors":
        if (self.position_noise is None) == (self.encoder_bits is None):
            raise ValueError("give position_noise or encoder_bits, and only one of them")
        return self

    @property
    def noise(self) -> float:
        """Standard deviation of each encoder's noise."""
        if self.position_noise is not None:
            return self.position_noise
        return float(2.0 * np.pi / 2.0 ** (self.encoder_bits or 0) / np.sqrt(12.0))


class Experiment(_Table):
    """Duration, sample time and number of tones of the experiment to design."""

    duration: Annotated[float, Field(ge=1, le=600, allow_inf_nan=False)]  # s
    sample_time: Annotated[float, Field(ge=1e-5, le=0.05, allow_inf_nan=False)]  # s
    harmonics: Annotated[int, Field(ge=2, le=40)] = 8  # number of tones

    @property
    def ramp(self) -> float:
        """Time in s in which the input rises at the start, and falls at the end."""
        return _RAMP * self.duration


class Drive(_Table):
    """Contents of a drive file: an assumed drive, and the experiment to design for it."""

    joint: JointType = "revolute"
    known: list[Literal["motor_inertia"]] = []  # known exactly; no other parameter can be
    parameters: Parameters
    limits: Limits
    sensors: Sensors
    experiment: Experiment

    @model_validator(mode="after")
    def _has_angles(self) -> "Drive":
        angular = self.parameters.gravity_torque, self.sensors.encoder_bits
        if self.joint == "prismatic" and any(value is not None for value in angular):
            raise ValueError(
                "a prismatic joint has no gravity_torque and no encoder_bits: give a "
                "link_offset_torque in N, and position_noise in m"
            )
        return self

    @property
    def values(self) -> dict[str, float]:
        """Assumed parameters by name, without those left out."""
        return self.parameters.model_dump(exclude_none=True)

    def document(self) -> dict[str, Any]:
        """Return the contents of the file, with all defaults."""
        return {
            "joint": self.joint,
            "parameters": self.values,
            "known": self.known,
            "limits": self.limits.model_dump(),
            "position_noise": self.sensors.noise,
            **self.experiment.model_dump(),
            "ramp": self.experiment.ramp,
        }

    @property
    def resonance(self) -> float:
        """Resonance of both inertias on the spring, in rad/s."""
        p = self.parameters
        inverse = 1.0 / p.link_inertia + 1.0 / p.motor_inertia
        return float(np.sqrt(p.joint_stiffness * inverse))

    @property
    def fastest(self) -> float:
        """Highest frequency of a tone in rad/s."""
        return _HIGHEST * self.resonance

    @property
    def coefficients(self) -> dict[str, float]:
        """All coefficients of the model, with known ones."""
        return joint_coefficients(self.values)

    def case(self, parameters: Mapping[str, float], name: str = "nominal") -> "Case":
        """Return the model with these parameters."""
        coefficients = joint_coefficients(parameters)
        terms = tuple(
            term for term, parameter in TERM_PARAMETERS.items() if parameter in parameters
        )
        known = {"beta1": coefficients["beta1"]} if self.known else {}
        system = flexible_joint(terms, known, COULOMB_VELOCITY[self.joint])
        return Case(name, system, {c: coefficients[c] for c in system.coefficients})

    @property
    def nominal(self) -> "Case":
        """Drive with the assumed parameters."""
        return self.case(self.values)

    def cases(self, seed: int) -> Iterator["Case"]:
        """Yield perturbed drives: each parameter alone up and down, then all at random corners."""
        values = self.values
        doubtful = [name for name in values if name not in self.known]
        for name, sign in product(doubtful, (-1.0, 1.0)):
            changed = {**values, name: values[name] * (1.0 + sign * DOUBT)}
            yield self.case(changed, f"{name} {100 * sign * DOUBT:+.0f} %")
        generator = np.random.default_rng(seed)
        for place in range(_RANDOM_CASES):
            signs = generator.choice([-1.0, 1.0], len(doubtful))
            corner = {
                name: values[name] * (1.0 + sign * DOUBT)
                for name, sign in zip(doubtful, signs.tolist(), strict=True)
            }
            yield self.case({**values, **corner}, f"random corner {place + 1}")


@dataclass(frozen=True, eq=False)
class Case:
    """Drive with given parameter values."""

    name: str  # how it differs from the nominal drive
    system: ParametricSystem
    coefficients: Mapping[str, float]  # of the system's unknowns, by name

    @property
    def values(self) -> FloatArray:
        """Values of the coefficients in the model's order, shape (k,)."""
        return np.array([self.coefficients[name] for name in self.system.coefficients])

    def play(self, torque: FloatArray, sample_time: float) -> "CaseRun":
        """Simulate a torque, shape (n,), that is held over each sample, from rest."""
        motion = self.system, self.coefficients, self.rest()
        return CaseRun(free_run(*motion, torque, sample_time, "zero"), torque, sample_time)

    def uses(self, torque: FloatArray, sample_time: float, limits: Limits) -> dict[str, float]:
        """Return each channel's largest magnitude over its limit; infinite if the run diverges."""
        try:
            return self.play(torque, sample_time).use(limits)
        except SimulationError:
            return dict.fromkeys(CHANNELS, np.inf)

    def rest(self) -> FloatArray:
        """Return the equilibrium without torque, shape (4,), or zeros without one."""
        model, still = model_kernel("plain_model", self.system), np.zeros(len(self.system.inputs))
        constants = np.array(list(self.system.constants.values()), dtype=np.float64)

        def accelerations(positions: FloatArray) -> FloatArray:
            state, rates = np.zeros(4), np.zeros(4)
            state[::2] = positions
            model.right_hand_side(state, still, self.values, constants, rates)
            return rates[1::2]

        state, start = np.zeros(4), np.zeros(2)
        found = root(accelerations, start) if accelerations(start).any() else None
        if found is not None and found.success:
            state[::2] = found.x
        return state


SEGMENT_DURATION = 1.0  # s: length of the segments that predictions assume

CHANNELS = ("torque", "velocity", "position", "deflection")


@dataclass(frozen=True, eq=False)
class CaseRun:
    """Simulated motion of a case under a torque."""

    states: FloatArray  # (n, 4): link position and velocity, motor position and velocity
    torque: FloatArray  # (n,): held from each sample to the next
    sample_time: float  # s

    def _channels(self) -> dict[str, FloatArray]:
        x = self.states
        return {
            "torque": self.torque,
            "velocity": x[:, 1::2],
            "position": x[:, ::2],
            "deflection": x[:, 0] - x[:, 2],
        }

    def peaks(self) -> dict[str, float]:
        """Return the largest magnitude of each limited channel."""
        return {name: float(np.abs(values).max()) for name, values in self._channels().items()}

    def shares(self, limits: Limits) -> dict[str, FloatArray]:
        """Return each channel over its limit, sample by sample."""
        return {name: values / getattr(limits, name) for name, values in self._channels().items()}

    def use(self, limits: Limits) -> dict[str, float]:
        """Return the largest magnitude of each channel over its limit."""
        return {name: peak / getattr(limits, name) for name, peak in self.peaks().items()}

    def motion(self, case: Case, noise: float) -> tuple[SegmentedMotion, Point]:
        """Return the motion over segments, as measured by two encoders with white noise."""
        samples = Samples(self.states[:, ::2], None, self.torque[:, None], self.sample_time)
        segments = divide([samples], SEGMENT_DURATION)
        point = Point(case.values, self.states[segments.starts])
        problem = segmented_motion(case.system, segments, Timing("zero"))
        return problem.at(point, np.full(2, 1.0 / noise)), point


_SLOWEST_SAMPLING = 10.0  # samples per period of the fastest tone
_FEWEST_SAMPLES = 200
_MOST_SAMPLES = 1_000_000


@dataclass(frozen=True)
class DriveFile:
    """Drive read from a file, with the files it is from and warnings."""

    drive: Drive
    inputs: tuple[tuple[str, str], ...]  # file names and SHA-256 digests
    warnings: tuple[str, ...] = ()


def read_drive(
    path: Path,
    estimate: StoredEstimate | None = None,
    choices: Mapping[str, Any] | None = None,
) -> DriveFile:
    """Read a drive file; `estimate` replaces parameters, `choices` keys of ``[experiment]``."""
    refuse = partial(refusal, str(path))
    raw = read_small(path, "a TOML file", refuse)
    inputs = [(path.name, hashlib.sha256(raw).hexdigest())]
    content = parse_toml(raw, refuse)
    experiment = content.get("experiment")
    if isinstance(experiment, dict):
        experiment.update(choices or {})
    drive = validated(content, Drive, refuse)
    warnings: list[str] = []
    if estimate is not None:
        inputs.append((Path(estimate.name).name, estimate.sha256))
        warnings = _take_over(content, estimate)
        drive = validated(content, Drive, refuse)
    _check_experiment(drive.experiment, drive.fastest, refuse)
    return DriveFile(drive, tuple(inputs), tuple(warnings))


def _take_over(content: dict[str, Any], stored: StoredEstimate) -> list[str]:
    """Replace parameters by estimates of the same name; return warnings."""
    estimate = stored.of_joint
    believed, joint = content["parameters"], content.get("joint", "revolute")
    if estimate.joint != joint:
        reason = f"is {estimate.joint!r}, but {joint!r} in the drive file: make them agree"
        raise stored.refuse("joint", reason)
    shapes = [term for term in estimate.choices.terms if term in SHAPE_TERMS]
    missing = [n for n in estimate.parameters if n in Parameters.model_fields and n not in believed]
    warnings, guessed = [], []
    if not believed.keys() & estimate.parameters.keys():
        raise stored.refuse(
            "parameters",
            f"has none of {', '.join(believed)}: identify a log with the motor's torque",
        )
    if shapes:
        warnings.append(f"a design does not model {', '.join(shapes)}, so its predictions omit it")
    if missing:
        warnings.append(
            f"{', '.join(missing)} is missing in the drive file, so the design leaves it out: "
            f"add the key with any value to use it"
        )
    for name, parameter in estimate.parameters.items():
        if name not in believed:
            continue
        if not isfinite(parameter.value):
            warnings.append(f"{name} has no finite value, so the value in the drive file is used")
            continue
        believed[name] = parameter.value
        if parameter.verdict == "undetermined":
            guessed.append(name)
    if guessed:
        warnings.append(
            f"{', '.join(guessed)} is undetermined, so the design relies on a guess: check its "
            f"largest deviations"
        )

    def refuse(key: str, _: str) -> Exception:
        reason = f"is {believed[key]}, which no drive has: identify a log that determines it"
        return stored.refuse(f"parameters.{key}", reason)

    validated(believed, Parameters, refuse)
    return [f"{stored.name}: {warning}" for warning in warnings]


def _check_experiment(wanted: Experiment, fastest: float, refuse: RefuseKey) -> None:
    """Raise if sample time, tones or duration do not suit the fastest tone, in rad/s."""
    samples = wanted.duration / wanted.sample_time
    if not _FEWEST_SAMPLES <= samples <= _MOST_SAMPLES:
        raise refuse(
            "experiment.sample_time",
            f"makes {samples:.0f} samples: choose it for {_FEWEST_SAMPLES} to {_MOST_SAMPLES}",
        )
    if fastest * wanted.sample_time * _SLOWEST_SAMPLING > 2.0 * pi:
        raise refuse(
            "experiment.sample_time",
            f"leaves fewer than {_SLOWEST_SAMPLING:.0f} samples per period of a tone of "
            f"{fastest:.3g} rad/s: sample faster",
        )
    if fastest * wanted.duration < 2.0 * pi * wanted.harmonics:
        raise refuse(
            "experiment.harmonics",
            f"is {wanted.harmonics}, more than {wanted.duration:g} s allow below "
            f"{fastest:.3g} rad/s: take fewer, or lengthen the duration",
        )
