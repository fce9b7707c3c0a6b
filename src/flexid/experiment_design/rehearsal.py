"""The identified model, ready to run under other inputs.

What another input would tell is computed from the model's motion as the prediction error sees it:
with the delays that are sought, over segments of the same length, in noise as large as the log's
residuals. On the log itself that gives a standard deviation which the identification's exceeds, as
residuals are correlated and no model is right; by that factor the prediction for another input is
made larger, too.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from flexid.analysis.information import information_at
from flexid.arrays import FloatArray
from flexid.errors import SimulationError
from flexid.estimators.samples import Samples
from flexid.estimators.segments import divide, first_states
from flexid.identification.estimation.excitations import row_sizes
from flexid.identification.full_model.model import Data
from flexid.identification.full_model.starting import least_squares_start
from flexid.identification.judgement.estimates import verdict
from flexid.identification.result.identification import Identification
from flexid.identification.structure.validation import following_states
from flexid.identification.vocabulary.evidence import CoefficientEstimate, Verdict
from flexid.identification.vocabulary.intervals import interval
from flexid.stored_estimates.joint_model import JointModel


@dataclass(frozen=True)
class Outlook:
    """What a motion would tell."""

    widths: Mapping[str, float]  # half the predicted 95 % intervals over the values
    verdicts: Mapping[str, Verdict]

    @property
    def enough(self) -> bool:
        """Whether every coefficient would be determined."""
        return all(verdict == "determined" for verdict in self.verdicts.values())

    @property
    def weakest(self) -> str:
        """The coefficient with the widest interval."""
        return max(self.widths, key=lambda name: self.widths[name])


@dataclass(frozen=True, eq=False)
class Rehearsal:
    """A model as identified, and the log that other inputs are tried on."""

    model: JointModel
    result: Identification
    record: Samples  # the beginning of the longest recording
    group: int  # of the logs, which the record comes from
    noise: FloatArray  # (n_rows,): standard deviation of each position's residual
    data: Data  # all that was measured

    @property
    def fastest(self) -> float:
        """Angular frequency in rad/s of the joint's resonance, or else of the pendulum."""
        p = dict(zip(self.model.unknowns.names, self.model.values.tolist(), strict=True))
        p |= self.model.unknowns.fixed
        squares = (
            p.get("theta2", 0.0) + p.get("alpha1", 0.0),
            p.get("theta1", 0.0),
            p.get("gamma1", 0.0),
        )
        return float(np.sqrt(max(0.0, *squares)))

    @property
    def repeats(self) -> float:
        """Length of all recordings over that of the record."""
        return self.data.duration / (len(self.record) * self.record.sample_time)

    def change(self, inputs: FloatArray) -> FloatArray:
        """What other inputs change about the positions, shape (n, n_rows), by the model."""
        return self._run(inputs) - self._recorded

    def outlook(self, change: FloatArray, inputs: FloatArray) -> Outlook:
        """What a changed motion would tell if as much of it were recorded as there was in all."""
        factors = self._factors
        moved = first_states(divide([replace(self.record, positions=change)], self._duration))
        states = self._states.copy()
        states[:, : moved.shape[1]] += moved  # what a model remembers of its path stays
        deviations = self._deviations(states, inputs)
        return self._judged({name: factors[name] * std for name, std in deviations.items()})

    @cached_property
    def _duration(self) -> float:
        return self.result.choices.segment_duration or self.data.duration

    @cached_property
    def _states(self) -> FloatArray:
        """States at the start of each segment of the log."""
        segments = divide([self.record], self._duration)
        problem, point = self.model.motion(segments, self.noise, self.data)
        return following_states(problem, point.values, segments)

    def _run(self, inputs: FloatArray) -> FloatArray:
        """Positions under an input from the start of the record on."""
        whole = divide([replace(self.record, inputs=inputs)], self.data.duration)
        problem, point = self.model.motion(whole, self.noise, self.data)
        equations = problem.equations(replace(point, initial_states=self._states[:1]), "nothing")
        if not np.isfinite(equations.cost):
            raise SimulationError("the model's motion diverges: see its coefficients", 0.0)
        return problem.timely(point.values) - equations.residuals

    @cached_property
    def _recorded(self) -> FloatArray:
        return self._run(self.record.inputs)

    @cached_property
    def in_white_noise(self) -> Outlook:
        """What the log itself would tell of a right model in white noise."""
        return self._judged(self._of_the_log)

    @cached_property
    def _of_the_log(self) -> dict[str, float]:
        return self._deviations(self._states, self.record.inputs)

    @cached_property
    def _factors(self) -> dict[str, float]:
        """Standard deviations of the identification over the prediction for its own log."""
        found = {}
        for name, predicted in self._of_the_log.items():
            estimate = self._estimate(name)
            factor = estimate.std / predicted if predicted > 0.0 else np.inf
            found[name] = factor if np.isfinite(factor) and factor > 0.0 else np.nan
        usable = [factor for factor in found.values() if np.isfinite(factor)]
        middle = float(np.median(usable)) if usable else 1.0
        return {name: f if np.isfinite(f) else middle for name, f in found.items()}

    def _estimate(self, name: str) -> CoefficientEstimate:
        coefficients = self.result.coefficients
        own = f"{name}[{self.group + 1}]"
        return coefficients[own if own in coefficients else name]

    def _deviations(self, states: FloatArray, inputs: FloatArray) -> dict[str, float]:
        """Standard deviations of the coefficients in white noise, segments starting from states."""
        segments = divide([replace(self.record, inputs=inputs)], self._duration)
        problem, point = self.model.motion(segments, self.noise, self.data, self.result.fit.names)
        point = replace(point, initial_states=states)
        information = information_at(problem, point)
        deviations = information.standard_deviations / np.sqrt(self.repeats)
        by_name = dict(zip(information.names, deviations.tolist(), strict=True))
        return {name: by_name[name] for name in self.model.unknowns.names}

    @cached_property
    def _sizes(self) -> dict[str, float]:
        """What each coefficient that may be absent does to its row in the log."""
        joint, rate = self.model.joint, self.result.choices.filter_rate
        sizes = row_sizes(least_squares_start(self.model.structure, self.data, rate)[1].rows)
        return {name: size for name, size in sizes.items() if name in joint.optional}

    def _judged(self, deviations: Mapping[str, float]) -> Outlook:
        fit = self.result.fit
        freedom = dict(zip(fit.names, fit.degrees_of_freedom, strict=True))
        least = min((f for f in freedom.values() if f > 0.0), default=1.0)
        widths, verdicts = {}, {}
        for name, std in deviations.items():
            now = self._estimate(name)
            of_fit = freedom.get(now.name, least)
            ends = interval(now.value, std, of_fit if of_fit > 0.0 else least)
            half = 0.5 * (ends[1] - ends[0])
            effect = half * self._sizes[name] if name in self._sizes else np.inf
            verdicts[name], _ = verdict(now.value, ends, effect)
            widths[name] = half / abs(now.value) if now.value else np.inf
        return Outlook(widths, verdicts)
