"""Recursive least squares with several filter rates in parallel, and their disagreement."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite, nan

import numpy as np

from flexid.arrays import FloatArray
from flexid.errors import ConvergenceError, SettingError
from flexid.estimators.online import History
from flexid.estimators.recursive_least_squares import recursive_least_squares
from flexid.identification.estimation.knowledge import Joined, with_prior_knowledge
from flexid.identification.judgement import Judge
from flexid.identification.preparation.stated import Stated
from flexid.identification.vocabulary.evidence import Estimate, ValueEstimate, quantile
from flexid.identification.vocabulary.thresholds import THRESHOLDS
from flexid.models.flexible_joint import POSITIVE
from flexid.models.physical import ANGLES, difference
from flexid.recording.recording import Hold
from flexid.streaming.health import LIMITS, Width
from flexid.streaming.options import RATES, WatchOptions

WORTH = 2.0
"""Standard deviation over the largest difference between filters. On 66 random logs of the blind
trials' families 97 % of the 95 % intervals contain the truth with 2, and 92 % with 1; on drives
outside the model class, 93 and 87 %."""

States = tuple[FloatArray, ...]


# A model error makes the estimates depend on the filter. So a slow and a fast filter run in
# parallel with the chosen one, and one with the other hold if the hold is open. `WORTH` times the
# largest difference counts as a standard deviation.
class Learner:
    """Online estimators of one model; their states are arrays, never changed in place."""

    def __init__(self, options: WatchOptions) -> None:
        self.options = options
        self.system = options.system
        self._is_driven = options.kind == "link"
        hold: Hold = "zero" if options.hold == "zero" else "linear"
        runs: list[tuple[float, Hold]] = [(rate, hold) for rate in RATES]
        if options.hold == "auto" and not self._is_driven:
            runs.append((1.0, "zero"))
        self._estimators = [
            recursive_least_squares(
                self.system, options.sample_time, rate * options.filter_rate, hold, options.memory
            )
            for rate, hold in runs
        ]
        self.main = self._estimators[0]

    def first_states(self, values: FloatArray | None = None) -> States:
        """Return the states before the first sample, with starting values of the coefficients."""
        names = self.system.coefficients
        start = {} if values is None else dict(zip(names, values.tolist(), strict=True))
        states = [estimator.init(start) for estimator in self._estimators]
        if self._is_driven:
            states.append(np.full(4, np.nan))
        return tuple(states)

    def learn(self, states: States, rows: FloatArray) -> tuple[States, History]:
        """Update the states with rows of positions and inputs; the history is the main one's."""
        last: States = ()
        if self._is_driven:
            rows, end = _driven(rows, states[-1], self.options.sample_time)
            last = (end,)
        histories = [
            estimator.replay(state, rows)
            for estimator, state in zip(self._estimators, states, strict=False)
        ]
        return (*(history.state for history in histories), *last), histories[0]

    def values(self, states: States) -> FloatArray:
        """Return the main estimator's coefficients, shape (n_coefficients,)."""
        return self.main.coefficients(states[0])

    def disagreement(self, states: States) -> FloatArray:
        """Return the largest difference between filters, shape (n_coefficients,)."""
        values = self.values(states)
        others = zip(self._estimators[1:], states[1:], strict=False)
        return np.max([np.abs(e.coefficients(s) - values) for e, s in others], axis=0)

    def estimate(self, states: States) -> Estimate:
        """Return the coefficients with a covariance from noise and disagreement."""
        apart = WORTH * self.disagreement(states)
        with np.errstate(over="ignore"):  # an infinite variance is that of an unknown value
            variances = apart**2
        return self.noise_estimate(states).widened(np.diag(variances))

    def noise_estimate(self, states: States) -> Estimate:
        """Return the coefficients with a covariance from noise alone."""
        with np.errstate(all="ignore"):  # extreme samples overflow; the result counts as unknown
            covariance, freedom = self.main.covariance(states[0])
        unknown = ~np.isfinite(np.diag(covariance))
        covariance[unknown, :] = covariance[:, unknown] = 0.0
        covariance[unknown, unknown] = np.inf
        return Estimate(
            self.system.coefficients, self.values(states), covariance, tuple(freedom.tolist())
        )


def _driven(rows: FloatArray, before: FloatArray, h: float) -> tuple[FloatArray, FloatArray]:
    """Return rows with the motor's motion as inputs, one sample late, and the last two samples."""
    known = np.vstack((before.reshape(2, 2), rows))
    link, motor = known.T
    velocity = (motor[2:] - motor[:-2]) / (2.0 * h)
    return np.column_stack((link[1:-1], motor[1:-1], velocity)), known[-2:].ravel()


@dataclass(frozen=True)
class Departure:
    """A physical parameter that differs between the reference estimate and the stream."""

    name: str  # of the parameter
    unit: str  # of the parameter
    was: float  # value in the reference estimate
    now: float  # value from the stream
    excess: float  # their difference over the limit

    @property
    def change(self) -> float:
        """Relative change; NaN for an angle."""
        return nan if self.name in ANGLES else self.now / self.was - 1.0

    @property
    def sentence(self) -> str:
        """Both values and the change, as a sentence for a report."""
        unit = f" {self.unit}" if self.unit else ""
        share = "" if self.name in ANGLES else f" ({100 * self.change:+.0f} %)"
        return f"{self.name} is {self.now:.4g}{unit}{share}, and {self.was:.4g} in the estimate"


def departures(
    reference: Mapping[str, tuple[float, float]],
    parameters: Mapping[str, ValueEstimate],
    *,
    widths: float,
    least: float,
) -> tuple[Departure, ...]:
    """Return the parameters that differ from the reference by more than a limit, largest first."""
    found = []
    for name, (was, half_was) in reference.items():
        now = parameters.get(name)
        if now is None or not isfinite(now.std):
            continue
        whole = 1.0 if name in ANGLES else abs(was)
        allowed = max(widths * (now.half_width**2 + half_was**2) ** 0.5, least * whole)
        excess = abs(difference(name, was, now.value)) / allowed if allowed > 0.0 else 0.0
        if excess > 1.0:
            found.append(Departure(name, now.unit, was, now.value, excess))
    return tuple(sorted(found, key=lambda departure: -departure.excess))


@dataclass(frozen=True, eq=False)
class Findings:
    """Estimates at one moment, and contradictions with known values."""

    estimate: Estimate  # of the unknown coefficients, combined with prior knowledge
    coefficients: dict[str, ValueEstimate]
    parameters: dict[str, ValueEstimate]  # physical parameters that the coefficients determine
    widths: list[Width]  # of spring and inertias
    departures: tuple[Departure, ...]  # parameters that differ from the reference estimate
    contradicted: tuple[str, ...]  # a sentence on each exactly known value that is contradicted
    against: tuple[str, ...]  # a sentence on each contradicted value known with a deviation


def findings(learner: Learner, states: States, estimate: Estimate, stated: Stated) -> Findings:
    """Return values, intervals and contradictions of an estimate with prior knowledge."""
    options = learner.options
    with np.errstate(all="ignore"):  # for extreme values
        joined = _joined(options, estimate, stated)
        fixed = {name: (value, "given") for name, value in options.given.items()}
        sizes = regressor_sizes(learner, states)
        judge = Judge(options.joint, options.unknowns, options.input_unit)
        coefficients, parameters = judge.judged(joined.estimate, fixed, sizes, joined.exact)
    departed = departures(
        options.reference, parameters, widths=LIMITS.departure, least=LIMITS.least_departure
    )
    found, apart = joined.estimate, learner.disagreement(states).tolist()
    halves = [
        quantile(freedom) * deviation if freedom > 0.0 else np.inf
        for freedom, deviation in zip(
            found.degrees_of_freedom, found.deviations.tolist(), strict=True
        )
    ]
    numbers = zip(found.names, found.values.tolist(), halves, apart, strict=True)
    widths = [Width(*each) for each in numbers if each[0] in POSITIVE]
    widths += [Width(n, value, 0.0, 0.0) for n, value in options.given.items() if n in POSITIVE]
    return Findings(
        found, coefficients, parameters, widths, departed, joined.contradicted, joined.against
    )


def _joined(options: WatchOptions, estimate: Estimate, stated: Stated) -> Joined:
    """Return the estimate with prior knowledge, or unchanged while that cannot be combined."""
    try:
        return with_prior_knowledge(
            options.joint, estimate, options.given, stated, options.input_unit, THRESHOLDS
        )
    except (SettingError, ConvergenceError):
        return Joined(estimate)


def regressor_sizes(learner: Learner, states: States) -> dict[str, float]:
    """Return the RMS of each regressor over the RMS of its row's left-hand side."""
    main, state = learner.main, states[0]
    power, _ = main.powers(state)
    return {
        name: float(np.sqrt(np.divide(max(square, 0.0), power[j])))
        for j, (row, gram) in enumerate(
            zip(learner.system.rows, main.information(state), strict=True)
        )
        for name, square in zip(row.coefficients, np.diag(gram), strict=True)
    }
