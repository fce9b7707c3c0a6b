"""Online estimation from a stream; the result does not depend on how it is cut into blocks."""

from dataclasses import dataclass, field, replace
from math import inf

import numpy as np

from flexid.arrays import FloatArray
from flexid.estimators.excitation import Excitation, excitation_of_gram
from flexid.estimators.online import Status
from flexid.identification.vocabulary.evidence import ValueEstimate
from flexid.streaming.guard import Counts, Guard
from flexid.streaming.health import LIMITS, Evidence, Judgement, Recent, contradicts, judge
from flexid.streaming.learner import Departure, Findings, Learner, States, findings
from flexid.streaming.options import WatchOptions

CAUSES = {
    "no_number": "a value is not finite or too large",
    "repeated": "they are repeated",
    "late": "they are late",
    "outliers": "a position jumps",
    "stuck": "an encoder stands still",
    "gaps": "samples are missing between them",
}
"""Causes of unusable samples, by their count's name, as text. Saturated inputs are no fault."""

FEWEST = 10  # equations in a window for a decision


@dataclass
class RecentWindow:
    """Sums over the current window, and the share of unusable samples in the last full one."""

    errors: FloatArray  # (n_rows,): sums of the squared innovations
    # (2, n_rows): mean squares of the residuals and of the left-hand sides, over all equations
    # before the first contradicting window
    usual: FloatArray
    equations: int = 0  # number of innovations in the sums
    # (n_causes + 1,): unusable samples by cause, and all samples, at the window's beginning
    counts_before: FloatArray = field(default_factory=lambda: np.zeros(len(CAUSES) + 1))
    bad_share: float = 0.0  # share of unusable samples in the last full window
    bad_cause: str = ""  # most frequent cause in the last full window

    def begin(self) -> None:
        """Begin the next window."""
        self.errors, self.equations = np.zeros_like(self.errors), 0

    def add(self, innovations: FloatArray) -> None:
        """Add innovations, shape (n, n_rows), in order, as rounding depends on the order."""
        known = innovations[np.isfinite(innovations).all(axis=1)]
        if len(known):
            with np.errstate(over="ignore"):
                self.errors = np.add.accumulate(np.vstack((self.errors, known**2)))[-1]
            self.equations += len(known)

    def count(self, counts: Counts) -> None:
        """Compute the share of unusable samples in the window from the guard's counts."""
        now = np.array([*(getattr(counts, name) for name in CAUSES), counts.fed], dtype=float)
        *bad, fed = now - self.counts_before
        # Missing samples are not among those fed, so each gap adds one.
        came = fed + bad[-1]
        self.bad_share = float(sum(bad) / came) if came else 0.0
        self.bad_cause = [*CAUSES.values()][int(np.argmax(bad))]
        self.counts_before = now


def _total_weight(fading: float, count: int) -> float:
    return float(count) if fading == 1.0 else (1.0 - fading**count) / (1.0 - fading)


SETTLED = 2  # full windows that an estimate needs before a later one can contradict it


@dataclass(frozen=True)
class Change:
    """A change of the drive: the motion contradicted the estimates, and estimation restarted."""

    time: float  # of the restart, on the stream's clock, in s: the end of two such windows
    row: str  # whose prediction error rose most: ``"link"``, ``"motor"`` or ``"rigid"``
    # RMS of its prediction error in the last window over the usual RMS
    times_worse: float

    @property
    def sentence(self) -> str:
        """Time and size of the contradiction, as a sentence for a report."""
        return (
            f"since {self.time:.3f} s the prediction error of the {self.row} is "
            f"{self.times_worse:.2g} times as large as before: the load or the drive has changed, "
            f"and estimation has started again"
        )


@dataclass(frozen=True, eq=False)
class Memory:
    """States of the estimators after some sample, which can be restored."""

    fed: int  # number of samples up to then
    states: States  # of the estimators
    determined: bool  # whether the data determined every coefficient


class Session:
    """Online estimation from a stream of samples."""

    def __init__(self, options: WatchOptions) -> None:
        self.options = options
        self.learner = Learner(options)
        self.guard = Guard(options)
        self.window = max(1, round(LIMITS.window / (options.filter_rate * options.sample_time)))
        states = self.learner.first_states()
        self.guard_state = self.guard.first_state()
        self.fed = 0  # number of samples so far
        self.now = Memory(0, states, False)
        self.newer = self.older = self.now  # states at the start of this window, of the previous
        rows = len(self.learner.system.rows)
        self.recent = RecentWindow(np.zeros(rows), np.zeros((2, rows)))
        self.suspected = False
        self.changes: tuple[Change, ...] = ()  # of the drive: the last hundred
        self.n_changes = 0
        self._cached: tuple[Memory, Findings] | None = None

    def feed(self, samples: FloatArray) -> None:
        """Update the estimation with samples, shape (n, 1 + positions + inputs)."""
        samples = np.ascontiguousarray(samples, dtype=np.float64)
        done = 0
        while done < len(samples):
            until_closed = self.window - self.fed % self.window
            done += self._feed_some(samples[done : done + until_closed])
            if self.fed % self.window == 0:
                self._close_window()

    def _feed_some(self, samples: FloatArray) -> int:
        """Use samples of one window, up to a newly stuck encoder; return how many were used."""
        self.guard_state, judged, rows, stuck_for = self.guard.guard(self.guard_state, samples)
        self.fed += judged
        if stuck_for:
            self._go_back(self.fed - stuck_for)
        elif len(rows):
            states, history = self.learner.learn(self.now.states, rows)
            self.recent.add(history.innovations)
            # The first samples after a gap give no equation yet.
            status = history.status[np.isfinite(history.innovations).all(axis=1)]
            determined = bool(status[-1] == Status.USED) if len(status) else self.now.determined
            self.now = replace(self.now, states=states, determined=determined)
        self.now = replace(self.now, fed=self.fed)
        return judged

    def _go_back(self, since: int) -> None:
        """Restore a state from before `since`, the sample from which an encoder was stuck."""
        kept = [memory for memory in (self.newer, self.older) if memory.fed <= since]
        if kept:
            self.now = kept[0]
        elif since >= self.window:
            self.now = self.older
        else:  # the encoder was stuck from the beginning, so all estimates are wrong
            self.now = Memory(self.fed, self.learner.first_states(), False)
        self.newer = self.now
        self.recent.begin()

    def _close_window(self) -> None:
        """Evaluate the full window, restart after two contradictions, and begin the next one."""
        self.recent.count(self.counts)
        contradicting = [row for row in self._recent_rows() if contradicts(row)]
        if contradicting and self.suspected:
            worst = max(contradicting, key=lambda row: row.error / max(row.usual_error, 1e-300))
            self._restart(worst.row, worst.error / max(worst.usual_error, 1e-300))
        self.suspected = bool(contradicting) and not self.suspected
        main, state = self.learner.main, self.now.states[0]
        count = main.equations(state)
        if count and not contradicting:
            power, unexplained = main.powers(state)
            weight = _total_weight(main.law.fading, count)
            self.recent.usual = np.array([unexplained, power]) / weight
        self.older, self.newer = self.newer, self.now
        self.recent.begin()

    def _recent_rows(self) -> list[Recent]:
        """Return each row's mean squares in the window; empty if they are too few for a test."""
        main, recent = self.learner.main, self.recent
        state, begun = self.now.states[0], self.newer.states[0]
        before = main.equations(begun)
        since = main.equations(state) - before
        settled = self.now.determined and before >= SETTLED * self.window
        if not settled or recent.equations < FEWEST or since <= 0:
            return []
        power, power_before = main.powers(state)[0], main.powers(begun)[0]
        latest = np.maximum(power - main.law.fading**since * power_before, 0.0)
        columns = (recent.errors / recent.equations, latest / _total_weight(main.law.fading, since))
        numbers = np.vstack((*columns, recent.usual)).T.tolist()
        names = [row.name for row in self.learner.system.rows]
        return [Recent(name, *four) for name, four in zip(names, numbers, strict=True)]

    def _restart(self, row: str, worse: float) -> None:
        """Restart estimation at the current sample and values, and record the change."""
        values = self.learner.values(self.now.states)
        states = self.learner.first_states(np.nan_to_num(values))
        change = Change(self.time, row, float(min(worse, 1e300) ** 0.5))
        self.n_changes += 1
        self.changes = (*self.changes, change)[-100:]
        self.now = self.newer = Memory(self.fed, states, False)

    @property
    def counts(self) -> Counts:
        """Counts of samples and events so far."""
        return self.guard.counts(self.guard_state)

    @property
    def time(self) -> float:
        """Time of the latest sample in order, in s; NaN before the first."""
        return self.guard.time(self.guard_state)

    @property
    def health(self) -> Judgement:
        """Health of the estimation, with its reason."""
        return judge(self.evidence)

    @property
    def evidence(self) -> Evidence:
        """Figures that decide the health."""
        states, options = self.now.states, self.options
        equations = self.learner.main.equations(states[0])
        direction: tuple[str, ...] = ()
        if not self.now.determined and equations:
            worst = max(self.excitation.values(), key=lambda found: found.condition_number)
            direction = worst.confounded
        counts, found = self.counts, self.findings
        gaps = counts.gaps + counts.fed - counts.taken - counts.repeated - counts.late
        sentences = [departure.sentence for departure in found.departures]
        return Evidence(
            self.recent.bad_share,
            self.recent.bad_cause,
            self.guard.is_stuck(self.guard_state),
            equations * options.sample_time * options.filter_rate,
            self.now.determined,
            direction,
            found.widths,
            self.changes[-1].sentence if self.changes else "",
            next(iter((*sentences, *found.contradicted, *found.against)), ""),
            counts.taken * options.sample_time * options.filter_rate / gaps if gaps else inf,
        )

    @property
    def findings(self) -> Findings:
        """Values, intervals and contradictions, computed once per state."""
        if self._cached is None or self._cached[0] is not self.now:
            states, stated = self.now.states, self.options.stated
            estimate = self.learner.estimate(states)
            found = findings(self.learner, states, estimate, stated)
            self._cached = (self.now, found)
        return self._cached[1]

    @property
    def coefficients(self) -> dict[str, ValueEstimate]:
        """Coefficients of the model, with intervals and verdicts."""
        return self.findings.coefficients

    @property
    def parameters(self) -> dict[str, ValueEstimate]:
        """Physical parameters that the coefficients determine."""
        return self.findings.parameters

    @property
    def departures(self) -> tuple[Departure, ...]:
        """Parameters that differ from the reference estimate."""
        return self.findings.departures

    @property
    def excitation(self) -> dict[str, Excitation]:
        """Excitation of each row by the samples used: condition (A4) of Huang (2003), measured."""
        state = self.now.states[0]
        count = max(self.learner.main.equations(state), 1)
        grams = self.learner.main.information(state)
        for gram in grams:  # with very few samples, rounding may make a square negative
            np.fill_diagonal(gram, np.maximum(np.diag(gram), 0.0))
        return {
            row.name: excitation_of_gram(row.name, row.coefficients, gram / count)
            for row, gram in zip(self.learner.system.rows, grams, strict=True)
        }
