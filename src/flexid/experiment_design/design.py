"""The work of ``flexid design``: search, check on drives that are wrong, scale."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from operator import attrgetter

import numpy as np

import flexid
from flexid.arrays import FloatArray
from flexid.errors import SettingError
from flexid.estimators.excitation import information_at
from flexid.experiment_design.drive import (
    DOUBT,
    SEGMENT_DURATION,
    Case,
    CaseRun,
    Drive,
    DriveFile,
)
from flexid.experiment_design.excitation_report import DETERMINED_DEVIATION
from flexid.experiment_design.optimise import Search, deviation


@dataclass(frozen=True)
class Prediction:
    """What an input would determine of the drive as it is believed to be."""

    # predicted standard deviation of each coefficient over its value
    deviations: Mapping[str, float]
    e_deviation: float  # criterion E as a relative standard deviation
    peaks: Mapping[str, float]  # of each channel that has a limit
    torque_rms: float

    @property
    def worst(self) -> float:
        """Largest of the deviations."""
        return max(self.deviations.values())


@dataclass(frozen=True)
class Extreme:
    """The largest value over wrong drives, and which one it was."""

    value: float
    case: str


@dataclass(frozen=True, eq=False)
class Design:
    """An experiment, its predictions and its checks."""

    drive: Drive
    angular_frequencies: FloatArray  # (m,): rad/s
    weights: FloatArray  # (2 m,): of cosines and sines
    time: FloatArray  # (n,): s
    run: CaseRun  # of the drive as believed
    prediction: Prediction
    largest_use: Mapping[str, Extreme]  # of each limit, over all wrong drives
    largest_deviations: Mapping[str, Extreme]  # of each coefficient, over all wrong drives
    scale: float  # factor on what the search found, so that all drives keep to the limits
    seed: int  # of the search and of the wrong drives
    provenance: Mapping[str, object]  # version, inputs with their hashes, settings
    warnings: tuple[str, ...]  # parts of an estimate that are not used, or are uncertain

    @property
    def supported(self) -> bool:
        """Whether every coefficient would be known to 10 % or better."""
        return self.prediction.worst <= DETERMINED_DEVIATION


STARTS = 2
"""Random starts of the search."""

_LARGEST_SCALE = 2.0
_HALVINGS = 12  # of the interval that the scale is sought in
_STEP_BACK = 0.98
_SMALLEST_SCALE = 1e-3  # below which limits leave no motion to speak of


def design(file: DriveFile, seed: int, finished: Callable[[str], None]) -> Design:
    """Design an experiment."""
    drive = file.drive
    search, sample_time = Search(drive, seed), drive.experiment.sample_time
    nominal, everyone = search.nominal, (search.nominal, *search.cases)
    _check_rest(drive, everyone)
    candidates = []
    for found in search.run(STARTS, finished):
        coarse, fine = search.coarse.signal(found), search.fine.signal(found)
        scale = _scale(drive, coarse, search.step, fine, everyone)
        run = nominal.play(scale * fine, sample_time)
        candidates.append((predict(drive, nominal, run), scale, found, run))
    prediction, scale, weights, run = min(candidates, key=lambda one: one[0].e_deviation)
    finished("limits checked on wrong drives")
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
    """What a run of a case would tell."""
    information = information_at(*run.motion(case, drive.sensors.noise))
    return Prediction(
        dict(zip(information.names, information.relative_deviations.tolist(), strict=True)),
        deviation(information.relative),
        run.peaks(),
        float(np.sqrt(np.mean(run.torque**2))),
    )


def _check_rest(drive: Drive, cases: Sequence[Case]) -> None:
    for case in cases:
        if np.abs(case.rest()).max() >= drive.limits.position:
            raise SettingError(
                "limits.position",
                f"is exceeded at rest already ({case.name}): raise it, or correct the offsets",
            )


def _scale(
    drive: Drive, coarse: FloatArray, step: float, fine: FloatArray, cases: Sequence[Case]
) -> float:
    """Largest factor at which every drive keeps to the limits."""

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
            "limits", "leave no motion that could tell anything: raise the tightest of them"
        )
    return low


def _largest(by_case: Mapping[str, Mapping[str, float]]) -> dict[str, Extreme]:
    """Of each quantity the largest value."""
    names = next(iter(by_case.values()))
    return {
        name: max(
            (Extreme(one[name], case) for case, one in by_case.items()), key=attrgetter("value")
        )
        for name in names
    }
