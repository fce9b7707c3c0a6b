"""Design of an input for identification: search, check on perturbed drives, scale."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from operator import attrgetter

import numpy as np
from scipy.optimize import minimize

import flexid
from flexid.arrays import FloatArray
from flexid.errors import SettingError, SimulationError
from flexid.estimators.excitation import information_at
from flexid.estimators.segmented_motion import Point, SegmentedMotion
from flexid.experiment_design.drive import DOUBT, SEGMENT_DURATION, Case, CaseRun, Drive, DriveFile
from flexid.experiment_design.excitation_report import DETERMINED_DEVIATION

_SAMPLES_PER_RADIAN = 4.0  # of the fastest tone, in the search
_MAIN_TONE, _DOMINANCE = 0.25, 10.0  # of start 0: over the resonance; over other amplitudes
_TIE = 2.0  # weight of (log U)²
_NORM = 24.0  # order of the p-norm that replaces a largest magnitude
_NORM_OF_USES = 16.0  # order of the p-norm that replaces a largest use
_NEAR = 0.8  # use of a limit beyond which a perturbed drive is watched
_FIRST, _SECOND = 25, 20  # iterations of the two searches
_STEP = 1e-4  # of finite differences, over the typical size of a weight
_LOST = 100.0  # cost of a motion that diverges
_SHARPNESS = 4.0  # of the soft minimum that replaces the smallest eigenvalue
_FLOOR = 1e-14  # of eigenvalues, over the largest one


# s(t) = w(t) Σ_k [a_k cos(ω_k t) + b_k sin(ω_k t)], ω_k = 2π n_k / T. The integers n_k are evenly
# spaced on a logarithmic scale. The window w rises and falls along half a cosine.
@dataclass(frozen=True, eq=False)
class Waveform:
    """Windowed tones, zero at both ends, at the samples of an experiment."""

    angular_frequencies: FloatArray  # (m,): rad/s
    time: FloatArray  # (n,): s
    columns: FloatArray  # (n, 2 m): windowed cosines, then windowed sines

    def signal(self, weights: FloatArray) -> FloatArray:
        """Return the signal, shape (n,), for weights a_1 … a_m, b_1 … b_m."""
        return self.columns @ weights


def waveform(
    duration: float, sample_time: float, ramp: float, highest_frequency: float, harmonics: int
) -> Waveform:
    """Return windowed tones for an experiment; times in s, frequency in rad/s."""
    base = 2.0 * np.pi / duration
    most = max(harmonics, int(highest_frequency / base))
    numbers = np.unique(np.rint(np.geomspace(1.0, most, harmonics)).astype(int))
    spare = [n for n in range(1, most + 1) if n not in numbers][: harmonics - len(numbers)]
    rates = base * np.sort(np.concatenate((numbers, spare))).astype(np.float64)
    time = sample_time * np.arange(round(duration / sample_time) + 1, dtype=np.float64)
    window = 0.5 - 0.5 * np.cos(np.pi * np.clip(np.minimum(time, duration - time) / ramp, 0.0, 1.0))
    phase = np.outer(time, rates)
    return Waveform(rates, time, window[:, None] * np.hstack((np.cos(phase), np.sin(phase))))


# The cost is log(σ U), with σ the criterion as a standard deviation and U the largest use of a
# limit. For small motions it does not depend on the amplitude, only on the shape of the signal.
# (log U)² keeps U near 1. In a second search U includes the perturbed drives that use a limit most.
class Search:
    """Search for the weights of the tones."""

    def __init__(self, drive: Drive, seed: int) -> None:
        self.drive = drive
        self.seed = seed  # of the random starts and perturbed drives
        wanted = drive.experiment
        count = max(1, int(1.0 / (_SAMPLES_PER_RADIAN * drive.fastest) / wanted.sample_time))
        self.coarse, self.fine = (  # tones at the samples of the search and the experiment
            waveform(wanted.duration, step, wanted.ramp, drive.fastest, wanted.harmonics)
            for step in (count * wanted.sample_time, wanted.sample_time)
        )
        self.step = float(self.coarse.time[1])  # s
        self.nominal = drive.nominal
        self.cases = tuple(drive.cases(seed))  # perturbed drives

    @cached_property
    def _problem(self) -> SegmentedMotion:
        """Motion of the nominal drive over segments; `cost` replaces inputs and states."""
        step = self.step
        run = self.nominal.play(self.coarse.signal(self.start(0)), step)
        # The noise is reduced so that fewer samples carry the information of all samples.
        noise = self.drive.sensors.noise * np.sqrt(self.drive.experiment.sample_time / step)
        return run.motion(self.nominal, noise)[0]

    def cost(self, weights: FloatArray, watched: Sequence[Case]) -> float:
        """Return the cost of a signal, with the limits of `watched` perturbed drives included."""
        step = self.step
        torque = self.coarse.signal(weights)
        try:
            run = self.nominal.play(torque, step)
            segments = replace(self._problem.segments, inputs=run.torque[:, None])
            point = Point(self.nominal.values, run.states[segments.starts])
            information = information_at(replace(self._problem, segments=segments), point)
            runs = [run, *(case.play(torque, step) for case in watched)]
        except SimulationError:
            return _LOST
        uses = np.array([use for one in runs for use in self._smooth_uses(one)])
        log_use = float(np.log(np.mean(uses**_NORM_OF_USES))) / _NORM_OF_USES
        return smooth_cost(information.relative) + log_use + _TIE * log_use**2

    def _smooth_uses(self, run: CaseRun) -> list[float]:
        """Return a smooth approximation of the use of each limit."""
        uses = []
        for share in run.shares(self.drive.limits).values():
            magnitudes = np.abs(share)
            largest = max(float(magnitudes.max()), 1e-300)
            norm = float(np.mean((magnitudes / largest) ** _NORM)) ** (1.0 / _NORM)
            uses.append(largest * norm)
        return uses

    def furthest(self, weights: FloatArray) -> list[Case]:
        """Return for each channel the perturbed drive with the largest use, if above 0.8."""
        torque = self.coarse.signal(weights)
        furthest: dict[str, tuple[float, Case]] = {}
        for case in self.cases:
            for name, use in case.uses(torque, self.step, self.drive.limits).items():
                if use > furthest.get(name, (_NEAR, case))[0]:
                    furthest[name] = (use, case)
        return list({case.name: case for _, case in furthest.values()}.values())

    def start(self, place: int) -> FloatArray:
        """Return random weights within the nominal drive's limits; start 0 has a dominant tone."""
        generator = np.random.default_rng([self.seed, place])
        rates = self.coarse.angular_frequencies
        weights = generator.standard_normal(2 * len(rates))
        if place == 0:
            main = int(np.argmin(np.abs(np.log(_MAIN_TONE * self.drive.resonance / rates))))
            weights[len(rates) + main] = _DOMINANCE
        for _ in range(60):
            torque = self.coarse.signal(weights)
            worst = max(self.nominal.uses(torque, self.step, self.drive.limits).values())
            if worst <= 1.0:
                break
            weights *= max(0.9 / worst, 0.3)
        return weights

    def run(self, starts: int, finished: Callable[[str], None]) -> list[FloatArray]:
        """Return the weights found from each start, to be compared at the full sampling rate."""
        found = []
        for place in range(starts):
            weights = self._descend(self.start(place), (), _FIRST)
            weights = self._descend(weights, self.furthest(weights), _SECOND)
            found.append(weights)
            finished(f"search {place + 1} of {starts}")
        return found

    def _descend(self, weights: FloatArray, watched: Sequence[Case], iterations: int) -> FloatArray:
        size = float(np.sqrt(np.mean(weights**2)))
        result = minimize(
            lambda z: self.cost(size * z, watched),
            weights / size,
            method="L-BFGS-B",
            options={"maxiter": iterations, "maxfun": 10**9, "eps": _STEP},
        )
        return size * result.x


def deviation(relative_information: FloatArray) -> float:
    """Return criterion E, the relative standard deviation 1/√(min λ) of the worst direction."""
    lowest = float(np.linalg.eigvalsh(relative_information)[0])
    return lowest**-0.5 if lowest > 0.0 else float("inf")


def smooth_cost(relative_information: FloatArray) -> float:
    """Return a smooth and finite approximation of the logarithm of `deviation`."""
    eigenvalues = np.linalg.eigvalsh(relative_information)
    eigenvalues = np.maximum(eigenvalues, max(_FLOOR * eigenvalues[-1], 1e-300))
    logs = np.log(eigenvalues)
    lowest = logs.min()
    spread = np.log(np.sum(np.exp(-_SHARPNESS * (logs - lowest)))) / _SHARPNESS
    return float(0.5 * (spread - lowest))


@dataclass(frozen=True)
class Prediction:
    """Predicted accuracy of an identification, and size of the input and motion."""

    # predicted standard deviation of each coefficient over its value
    deviations: Mapping[str, float]
    e_deviation: float  # criterion E as a relative standard deviation
    peaks: Mapping[str, float]  # of each limited channel
    torque_rms: float

    @property
    def worst(self) -> float:
        """Largest of the predicted relative standard deviations."""
        return max(self.deviations.values())


@dataclass(frozen=True)
class Extreme:
    """Largest value over perturbed drives, and the name of the drive."""

    value: float
    case: str


@dataclass(frozen=True, eq=False)
class Design:
    """Designed experiment with its predictions and checks."""

    drive: Drive
    angular_frequencies: FloatArray  # (m,): rad/s
    weights: FloatArray  # (2 m,): of cosines and sines
    time: FloatArray  # (n,): s
    run: CaseRun  # of the nominal drive
    prediction: Prediction
    largest_use: Mapping[str, Extreme]  # of each limit, over perturbed drives
    largest_deviations: Mapping[str, Extreme]  # of each coefficient, over perturbed drives
    scale: float  # factor on the search's result, with which all drives keep the limits
    seed: int  # of the search and of the perturbed drives
    provenance: Mapping[str, object]  # version, inputs with their hashes, settings
    warnings: tuple[str, ...]  # about unused or undetermined parts of an estimate

    @property
    def supported(self) -> bool:
        """Whether every coefficient would be determined, from its predicted deviation."""
        return self.prediction.worst <= DETERMINED_DEVIATION


STARTS = 2  # random starts of the search

_LARGEST_SCALE = 2.0
_HALVINGS = 12  # of the interval that contains the scale
_STEP_BACK = 0.98
_SMALLEST_SCALE = 1e-3  # smaller scales allow almost no motion


def design(file: DriveFile, seed: int, finished: Callable[[str], None]) -> Design:
    """Design an experiment; `finished` is called with the name of each step that is done."""
    drive = file.drive
    search, sample_time = Search(drive, seed), drive.experiment.sample_time
    nominal, everyone = search.nominal, (search.nominal, *search.cases)
    for case in everyone:
        if np.abs(case.rest()).max() >= drive.limits.position:
            raise SettingError(
                "limits.position",
                f"is exceeded even at rest ({case.name}): raise it, or correct the offsets",
            )
    candidates = []
    for found in search.run(STARTS, finished):
        coarse, fine = search.coarse.signal(found), search.fine.signal(found)
        scale = _scale(drive, coarse, search.step, fine, everyone)
        run = nominal.play(scale * fine, sample_time)
        candidates.append((predict(drive, nominal, run), scale, found, run))
    prediction, scale, weights, run = min(candidates, key=lambda one: one[0].e_deviation)
    finished("limits checked on perturbed drives")
    wrong = {case.name: (case, case.play(run.torque, sample_time)) for case in search.cases}
    use = {name: one.use(drive.limits) for name, (_, one) in wrong.items()}
    deviations = {name: predict(drive, *one).deviations for name, one in wrong.items()}
    return Design(
        drive,
        search.fine.angular_frequencies,
        scale * weights,
        search.fine.time,
        run,
        prediction,
        _largest(use),
        _largest(deviations),
        scale,
        seed,
        {
            "flexid_version": flexid.__version__,
            "inputs": [{"file": name, "sha256": sha256} for name, sha256 in file.inputs],
            "segment_duration": SEGMENT_DURATION,
            "doubt": DOUBT,
            "starts": STARTS,
            "wrong_drives": len(search.cases),
        },
        file.warnings,
    )


def predict(drive: Drive, case: Case, run: CaseRun) -> Prediction:
    """Predict the accuracy of an identification from a run of a case."""
    information = information_at(*run.motion(case, drive.sensors.noise))
    return Prediction(
        dict(zip(information.names, information.relative_deviations.tolist(), strict=True)),
        deviation(information.relative),
        run.peaks(),
        float(np.sqrt(np.mean(run.torque**2))),
    )


def _scale(
    drive: Drive, coarse: FloatArray, step: float, fine: FloatArray, cases: Sequence[Case]
) -> float:
    """Return the largest factor with which every drive keeps the limits."""

    def fits(torque: FloatArray, sample_time: float) -> bool:
        uses = (case.uses(torque, sample_time, drive.limits) for case in cases)
        return all(max(use.values()) <= 1.0 for use in uses)

    low, high = 0.0, _LARGEST_SCALE
    if fits(high * coarse, step):
        low = high
    for _ in range(_HALVINGS if low < high else 0):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if fits(middle * coarse, step) else (low, middle)
    while low > _SMALLEST_SCALE and not fits(low * fine, drive.experiment.sample_time):
        low *= _STEP_BACK  # coarse samples miss some peaks
    if low <= _SMALLEST_SCALE:
        raise SettingError(
            "limits", "allow too little motion to identify anything: raise the tightest of them"
        )
    return low


def _largest(by_case: Mapping[str, Mapping[str, float]]) -> dict[str, Extreme]:
    """Return the largest value of each quantity over all cases."""
    names = next(iter(by_case.values()))
    return {
        name: max(
            (Extreme(one[name], case) for case, one in by_case.items()), key=attrgetter("value")
        )
        for name in names
    }
