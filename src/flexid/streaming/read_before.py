"""The part of a file that a session from a checkpoint has learnt from already, which is left out.

Counted once more, as independent samples, it would narrow every interval.
"""

import numpy as np

from flexid.arrays import FloatArray
from flexid.streaming.session import Session

FIRST = 200  # samples by which a file is known again; as many as are waited for at its beginning


class ReadBefore:
    """Leaves out what a session has read of a file before."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._held = session.first_read[:0]
        self._left = session.n_read
        self._compared = session.n_read == 0

    def new(self, samples: FloatArray, *, last: bool) -> FloatArray:
        """Those of the samples that the session has not read."""
        if not self._compared:
            samples = self._held = np.vstack((self._held, samples))
            known = self._session.first_read
            if len(samples) < len(known) and not last:
                return samples[:0]
            self._compared = True
            count = min(len(samples), len(known))
            if not np.array_equal(samples[:count], known[:count], equal_nan=True):
                self.begin_anew()
        left_out = min(self._left, len(samples))
        self._left -= left_out
        return samples[left_out:]

    def begin_anew(self) -> None:
        """Expect another file, of which nothing was read."""
        self._session.n_read = self._left = 0
        self._session.first_read = self._session.first_read[:0]
        self._held = self._session.first_read
        self._compared = True

    def note(self, samples: FloatArray) -> None:
        """Count samples that the session was fed."""
        session = self._session
        room = FIRST - len(session.first_read)
        if room > 0:
            session.first_read = np.vstack((session.first_read, samples[:room]))
        session.n_read += len(samples)
