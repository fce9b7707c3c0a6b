"""Channels of a stream that are late, put on the motor encoder's clock sample by sample.

What `flexid.identification.preparation.alignment.aligned` does to a recording, done to rows as they
come: the link passes an all-pass filter, the input a straight line between two samples.
"""

from math import ceil, floor

import numpy as np

from flexid.arrays import FloatArray
from flexid.recording.shift import ORDER, all_pass, spoilt
from flexid.streaming.options import WatchOptions


class Delays:
    """Rows of positions and inputs without the delays of the options."""

    def __init__(self, options: WatchOptions) -> None:
        drive = options.input_delay / options.sample_time
        link = -options.link_delay / options.sample_time
        whole = round(link)
        self._filter = None if link == whole else all_pass(link - whole)
        self._shift = whole if self._filter is None else whole - ORDER  # of the link, samples
        self._lag = floor(drive)  # of the input, samples
        self._part = drive - self._lag
        self._from_deflection = options.from_deflection
        self._has_input = options.n_inputs > 0
        self._width = options.n_encoders + options.n_inputs
        behind = max(0, self._shift, self._lag + 1)
        self._ahead = max(0, -self._shift, -self._lag)  # samples that are waited for
        self._span = behind + self._ahead
        self._skipped = max(behind, spoilt(link)[0], ceil(drive))  # rows of a run, at its beginning

    def first_state(self) -> FloatArray:
        """State before a run: rows so far, the filter's memory, and the latest rows."""
        return np.zeros(1 + ORDER + self._span * self._width)

    def undone(self, state: FloatArray, rows: FloatArray) -> tuple[FloatArray, FloatArray]:
        """New state, and the rows that can be known by now; a row of NaN ends a run."""
        found = [rows[:0]]
        for run in np.split(rows, np.flatnonzero(np.isnan(rows).any(axis=1))):
            if len(run) and np.isnan(run[0]).any():
                state = self.first_state()
                found.append(run[:1])
                run = run[1:]
            if len(run):
                state, known = self._go_on(state, run)
                found.append(known)
        return state, np.concatenate(found)

    def _go_on(self, state: FloatArray, run: FloatArray) -> tuple[FloatArray, FloatArray]:
        count, memory = int(state[0]), state[1 : 1 + ORDER]
        kept = state[1 + ORDER :].reshape(self._span, self._width)
        new = run.copy()
        if self._from_deflection:  # the deflection alone is late
            new[:, 0] -= run[:, 1]
        if self._filter is not None:
            new[:, 0], memory = self._filtered(new[:, 0], memory, begins=count == 0)
        rows = np.vstack((kept, new))
        first = max(count - self._ahead, self._skipped)
        last = max(first, count + len(run) - self._ahead)
        places = np.arange(first, last) - (count - self._span)
        known = rows[places]
        known[:, 0] = rows[places - self._shift, 0]
        if self._from_deflection:
            known[:, 0] += known[:, 1]
        if self._has_input:
            at = places - self._lag
            known[:, -1] = (1.0 - self._part) * rows[at, -1] + self._part * rows[at - 1, -1]
        latest = rows[len(rows) - self._span :].ravel()
        return np.concatenate(([count + len(run)], memory, latest)), known

    def _filtered(
        self, values: FloatArray, memory: FloatArray, *, begins: bool
    ) -> tuple[FloatArray, FloatArray]:
        from scipy.signal import lfilter, lfilter_zi  # takes half a second, and few need it

        assert self._filter is not None
        numerator = self._filter[::-1]
        if begins:
            memory = lfilter_zi(numerator, self._filter) * values[0]
        found, memory = lfilter(numerator, self._filter, values, zi=memory)
        return np.asarray(found), np.asarray(memory)
