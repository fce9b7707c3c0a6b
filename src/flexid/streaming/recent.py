"""The recent window, counted in samples: how well the latest could be used, and were predicted."""

from dataclasses import dataclass, field

import numpy as np

from flexid.arrays import FloatArray
from flexid.streaming.guard import Counts
from flexid.streaming.health import Recent
from flexid.streaming.learner import Learner, States

CAUSES = {
    "no_number": "a value is not a number",
    "repeated": "they are repeated",
    "late": "they are late",
    "outliers": "a position jumps",
    "stuck": "an encoder stands still",
    "gaps": "samples are missing between them",
}
"""What makes a sample bad, by its count, in words. One at the input's limit is a good one."""

FEWEST = 10  # equations in a window that say anything


@dataclass
class RecentWindow:
    """Sums over the window that is not full yet, and what the last full one said."""

    errors: FloatArray  # (n_rows,): σ of the squared innovations
    equations: int  # how many
    powers: FloatArray  # (n_rows,): the main estimator's at the beginning of the window
    equations_before: int  # its equations then
    # (2, n_rows): mean squares of what was unexplained and of the left-hand sides, in all
    # that was learnt before the first window that contradicts it
    usual: FloatArray
    # (n_causes + 1,): bad samples by cause then, and all
    counts_before: FloatArray = field(default_factory=lambda: np.zeros(len(CAUSES) + 1))
    bad_share: float = 0.0  # of the last full window
    bad_cause: str = ""  # most frequent cause there

    @classmethod
    def at(cls, learner: Learner, states: States) -> "RecentWindow":
        """A window that begins with some states."""
        return cls(*_beginning(learner, states), np.zeros((2, len(learner.system.rows))))

    def begin(self, learner: Learner, states: States) -> None:
        """Begin again from some states."""
        begun = _beginning(learner, states)
        self.errors, self.equations, self.powers, self.equations_before = begun

    def add(self, innovations: FloatArray) -> None:
        """Add innovations, shape (n, n_rows), one after the other: sums depend on their order."""
        known = innovations[np.isfinite(innovations).all(axis=1)]
        if len(known):
            with np.errstate(over="ignore"):
                self.errors = np.add.accumulate(np.vstack((self.errors, known**2)))[-1]
            self.equations += len(known)

    def count(self, counts: Counts) -> None:
        """Close the window over the guard's counts."""
        now = np.array([*(getattr(counts, name) for name in CAUSES), counts.fed], dtype=float)
        change = now - self.counts_before
        bad = change[:-1]
        # What is missing did not come, and counts as if it had: one for each gap.
        came = change[-1] + bad[-1]
        self.bad_share = float(bad.sum() / came) if came else 0.0
        self.bad_cause = [*CAUSES.values()][int(np.argmax(bad))]
        self.counts_before = now

    def of_rows(self, learner: Learner, states: States) -> list[Recent]:
        """What each row did in the window; empty if hardly anything was learnt from."""
        main, state = learner.main, states[0]
        count = main.equations(state)
        if self.equations < FEWEST or count <= self.equations_before:
            return []
        power, _ = main.powers(state)
        since = count - self.equations_before
        latest = np.maximum(power - main.fading**since * self.powers, 0.0)
        span = _weight(main.fading, since)
        return [
            Recent(
                row.name,
                float(self.errors[j] / self.equations),
                float(latest[j] / span),
                *self.usual[:, j].tolist(),
            )
            for j, row in enumerate(learner.system.rows)
        ]

    def accept(self, learner: Learner, states: States) -> None:
        """Count the window among what is usual."""
        count = learner.main.equations(states[0])
        if count:
            power, unexplained = learner.main.powers(states[0])
            self.usual = np.array([unexplained, power]) / _weight(learner.main.fading, count)


def _weight(fading: float, count: int) -> float:
    return float(count) if fading == 1.0 else (1.0 - fading**count) / (1.0 - fading)


def _beginning(learner: Learner, states: States) -> tuple[FloatArray, int, FloatArray, int]:
    power, _ = learner.main.powers(states[0])
    count = learner.main.equations(states[0])
    return np.zeros(len(learner.system.rows)), 0, power, count
