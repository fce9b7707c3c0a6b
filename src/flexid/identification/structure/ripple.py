"""Torque that repeats with the motor's position: how many times in a turn it may do so.

Cogging, the teeth of a gear and an uneven commutation act on the motor as a sine of its position.
What least squares of the motor's row leaves, summed over the position, shows in its spectrum how
many periods such a sine may have in a turn, unless there are but a few in the whole motion.
"""

import numpy as np

from flexid.arrays import FloatArray
from flexid.identification.full_model.model import Data, Structure
from flexid.identification.full_model.starting import least_squares_start
from flexid.identification.preparation.joint import Joint
from flexid.identification.structure.sought_shape import SoughtShape
from flexid.models.flexible_joint import RIPPLE_NUMBER, SHAPE_TERMS

_MOTOR = 1  # row and position
_RATES = (60.0, 200.0)  # 1/s, of the filters of least squares
_PEAKS = 4  # of a spectrum
_LARGEST = 500.0  # periods in a turn
_FASTEST = 0.5  # rad in a sampling interval, at the motor's usual velocity
_FEW = (1.0, 1.75, 2.5, 3.25, 4.0)  # periods in the range of the motion, which make no sharp peak
_FEWEST = 1.0  # periods in the range of the motion: fewer are any slow function of the position
_FINER = 8  # times the resolution of a spectrum
_BINS = 8  # in a period of the largest number
_MOST_BINS = 2**18  # of a spectrum, however many turns there are


def resolution(_: Joint, data: Data) -> float:
    """Difference of two numbers of periods in a turn: one period over the whole motion."""
    return 2.0 * np.pi / _range(data)


def _range(data: Data) -> float:
    """How far the motor moved, in rad."""
    positions = [recording.positions[:, _MOTOR] for recording in data.samples]
    return float(max(p.max() for p in positions) - min(p.min() for p in positions))


def numbers(structure: Structure, data: Data) -> list[float]:
    """Periods in a turn of which what least squares leaves may have some."""
    if not _range(data) > 0.0:
        return []
    apart = resolution(structure.joint, data)
    found = [few * apart for few in _FEW]
    for number in (peak for rate in _RATES for peak in _peaks(structure, data, rate)):
        if all(abs(number - other) > 0.5 * apart for other in found):
            found.append(number)
    return found


def _peaks(structure: Structure, data: Data, rate: float) -> list[float]:
    """Where the spectrum of what the motor's row leaves, by the position, has its largest peaks."""
    velocities = [structure.joint.both_sides(s)[1][:, _MOTOR] for s in data.samples]
    speed = float(np.sqrt(np.mean(np.concatenate(velocities) ** 2)))
    fastest = _FASTEST / max(speed * data.samples[0].sample_time, _FASTEST / _LARGEST)
    most = min(fastest, _MOST_BINS / _BINS * resolution(structure.joint, data))
    bin_width = 2.0 * np.pi / (_BINS * most)
    lowest = min(s.positions[:, _MOTOR].min() for s in data.samples)
    left = np.zeros(int(_range(data) / bin_width) + 1)
    row = least_squares_start(structure, data, rate)[1].rows[_MOTOR]
    residual, first = row.left_hand_side - row.fitted, 0
    for recording in data.samples:
        positions = recording.positions[1:-1, _MOTOR]
        own = residual[first : first + len(positions)]
        first += len(positions)
        back = _backwards(own, float(np.exp(-rate * recording.sample_time)))
        places = ((positions - lowest) / bin_width).astype(np.int64)
        left += np.bincount(places, weights=back, minlength=len(left))
    padded = _FINER * len(left)
    power = np.abs(np.fft.rfft(left, padded)) ** 2
    number = 2.0 * np.pi * np.arange(len(power)) / (padded * bin_width)
    usable = (number <= most) & (number >= _FEWEST * resolution(structure.joint, data))
    inner = np.flatnonzero((power[1:-1] > power[:-2]) & (power[1:-1] >= power[2:])) + 1
    inner = inner[usable[inner]]
    return number[inner[np.argsort(-power[inner])][:_PEAKS]].tolist()


def _backwards(signal: FloatArray, pole: float) -> FloatArray:
    """A signal backwards through the filter that delayed it: what it holds acts where it arose."""
    padded = 2 * len(signal)
    turns = np.exp(-2j * np.pi * np.arange(padded // 2 + 1) / padded)
    response = ((1.0 - pole) / (1.0 - pole * turns)) ** 2
    spectrum = np.fft.rfft(signal, padded) * response.conj()
    return np.fft.irfft(spectrum, padded)[: len(signal)]


RIPPLE = SoughtShape(
    "ripple of the torque",
    frozenset(SHAPE_TERMS["torque_ripple"].motor),
    RIPPLE_NUMBER,
    numbers,
    resolution,
)
"""Ripple, and the number of its periods in a turn."""
