"""How channels lie in time: inputs run on between their samples, and positions are read late."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from flexid.arrays import FloatArray
from flexid.estimators.held_input import held_input
from flexid.estimators.segments import Segments
from flexid.models.parametric_system import ParametricSystem
from flexid.recording.recording import Hold
from flexid.recording.shift import SETTLING, later

INPUT = "input_delay"
"""Name of the inputs' delay; that of a row's position is the row's name and ``_delay``."""

_SMALL = 1e-3  # of a sample, by which a delay differs where a derivative is by differences
_ABSOLUTE, _FIRST_INPUT = -1, -2  # places of what an output is measured relative to


@dataclass(frozen=True)
class Timing:
    """How the channels lie in time."""

    hold: Hold  # behaviour of the inputs between samples
    # in s, by name: `INPUT`, and ``link_delay`` for the position of the row ``link``. By so much
    # the inputs act, and the position was measured, later than recorded; what is missing is 0
    delays: Mapping[str, float] = field(default_factory=dict)
    sought: tuple[str, ...] = ()  # those that are sought; `delays` holds where to start
    # a row whose position was measured as a difference, which alone is late: the deflection. It is
    # named with the other row, or with an input that is a position and that the next input is the
    # velocity of
    relative_to: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class ChannelTiming:
    """The channels of some segments in time."""

    segments: Segments  # what was measured
    system: ParametricSystem  # whose rows and inputs the channels are
    timing: Timing  # hold and delays

    @cached_property
    def output_delays(self) -> tuple[str, ...]:
        """Name of each output's delay; measured velocities are never late."""
        rows = self.system.rows
        return tuple(
            f"{rows[state // 2].name}_delay" if state % 2 == 0 else ""
            for state in self.segments.measured.tolist()
        )

    def drives(self, delay: float) -> FloatArray:
        """Inputs between samples, shape (n_samples, n_inputs, 4)."""
        segments = self.segments
        drives = np.empty((*segments.inputs.shape, 4))
        for part, sample_time in segments.by_recording():
            drives[part] = held_input(segments.inputs[part], sample_time, self.timing.hold, delay)
        return drives

    def timely(self, delays: Mapping[str, float]) -> tuple[FloatArray, FloatArray]:
        """Outputs moved by whole samples to when they were true, and what is left of each delay."""
        segments = self.segments
        late = np.array([delays[name] if name else 0.0 for name in self.output_delays])
        if not late.any():
            return segments.outputs, late
        outputs = segments.outputs.copy()
        shortest = float(segments.sample_times.min())
        for a, delay in enumerate(late.tolist()):
            whole = round(delay / shortest)
            reference = self._reference_of(a)
            for part, _ in segments.by_recording():
                column = segments.outputs[part, a]
                if reference is not None:
                    column = column - reference[part]
                places = np.clip(np.arange(len(column)) + whole, 0, len(column) - 1)
                column = column[places]
                if reference is not None:
                    column = column + reference[part]
                outputs[part, a] = column
            late[a] -= whole * shortest
        return outputs, late

    def on_time(self, delays: Mapping[str, float]) -> FloatArray:
        """Outputs moved by any part of a sample to when they were true.

        White noise stays white, so that no delay makes innovations smaller than another.
        """
        late = np.array([delays[name] if name else 0.0 for name in self.output_delays])
        outputs = self.segments.outputs.copy()
        for a in np.flatnonzero(late).tolist():
            reference = self._reference_of(a)
            for part, sample_time in self.segments.by_recording():
                column = self.segments.outputs[part, a]
                still = np.zeros_like(column) if reference is None else reference[part]
                column = column - still
                before = 2.0 * column[0] - column[SETTLING:0:-1]  # turned round about its ends
                after = 2.0 * column[-1] - column[-2 : -SETTLING - 2 : -1]
                padded = np.concatenate((before, column, after))
                moved = later(padded, -late[a] / sample_time)
                outputs[part, a] = moved[len(before) : len(before) + len(column)] + still
        return outputs

    def rates_on_time(self, delays: Mapping[str, float]) -> FloatArray:
        """Derivatives of `on_time` by each output's own delay."""
        step = _SMALL * float(self.segments.sample_times.min())
        sooner, later = (
            self.on_time({name: delay + sign * step for name, delay in delays.items()})
            for sign in (-1.0, 1.0)
        )
        return (later - sooner) / (2.0 * step)

    def _reference_of(self, output: int) -> FloatArray | None:
        """What an output was measured relative to, shape (n_samples,), as far as delays go."""
        place = int(self.reference[output])
        if place == _ABSOLUTE:
            return None
        if place < _ABSOLUTE:
            return self.segments.inputs[:, _FIRST_INPUT - place]
        return self.segments.outputs[:, place // 2]  # outputs are positions in the rows' order

    @cached_property
    def reference(self) -> NDArray[np.int64]:
        """Place of what each output was measured relative to, as the kernel has it."""
        system = self.system
        rows = [row.name for row in system.rows]
        places = {name: 2 * place for place, name in enumerate(rows)}
        places |= {name: _FIRST_INPUT - place for place, name in enumerate(system.inputs)}
        relative_to = self.timing.relative_to
        return np.array(
            [
                places[relative_to[rows[state // 2]]]
                if rows[state // 2] in relative_to and state % 2 == 0
                else _ABSOLUTE
                for state in self.segments.measured.tolist()
            ],
            dtype=np.int64,
        )
