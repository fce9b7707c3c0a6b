"""Final fits to all data, and the covariance that their doubts add."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np

from flexid.arrays import FloatArray
from flexid.errors import ConvergenceError
from flexid.estimators.channel_timing import INPUT
from flexid.estimators.normal_equations import least_with, scaled_inverse
from flexid.estimators.state_variable_filter import LeastSquaresFit, RowFit
from flexid.identification.estimation.excitations import (
    one_way_frictions,
    row_sizes,
    unexcited,
    without_noise,
)
from flexid.identification.estimation.model_error import (
    driving_covariance,
    driving_frictions,
    model_error,
    stand_in_covariance,
    widened,
)
from flexid.identification.full_model.fits_by_length import hold_covariance
from flexid.identification.full_model.fitting import (
    expanded,
    fit_like,
    fit_to,
    lengths,
)
from flexid.identification.full_model.model import LINK, Data, Fitted, Structure, data_of
from flexid.identification.full_model.starting import first_fits, least_squares_start, suited_rate
from flexid.identification.preparation.recordings import SplitRecordings, aligned, given_alignment
from flexid.identification.structure.choice import Choice
from flexid.identification.structure.gap import settled, with_free_width
from flexid.identification.structure.link_delay import confused_covariance
from flexid.identification.structure.sought_terms import reflected
from flexid.identification.vocabulary.evidence import Estimate, ModelError
from flexid.identification.vocabulary.thresholds import THRESHOLDS, Thresholds
from flexid.models.flexible_joint import DISSIPATIVE, coefficients_of
from flexid.recording.velocities import with_velocities

_FRICTION = 0.05  # usual size of a friction, over its row's acceleration
_FRICTIONLESS = 1.0 / 9.0  # odds that a drive lacks a friction or damping
_NOISE_SEED = 1  # of noise that is added to measure the noise in each regressor


@dataclass(frozen=True, eq=False)
class FinalFits:
    """Fits to all data, including the held-out ends."""

    choice: Choice  # chosen structure, with the evidence
    recordings: SplitRecordings  # the data
    reported: Fitted  # fit of the chosen structure
    full: Fitted  # fit with all usual terms, for intervals of removed ones
    filter_rate: float  # of the filtered least squares, in 1/s
    # without disturbances:
    # fits over segments of growing length, some longer than those of `reported`
    lengths_fitted: Sequence[Fitted] = ()
    # model error that the residuals show
    error: ModelError = field(default_factory=lambda: ModelError(0.0, 0.0, 0.0))
    driving: frozenset[str] = frozenset()  # frictions that came out negative beyond noise

    @cached_property
    def in_full(self) -> Estimate:
        """Estimate of the full model."""
        return widened(self.full, self.error)

    @cached_property
    def squares(self) -> LeastSquaresFit:
        """Filtered least squares of the structure."""
        return self.least_squares(self.choice.structure)

    def least_squares(self, structure: Structure, data: Data | None = None) -> LeastSquaresFit:
        """Return filtered least squares of a structure, for the effect of each term on its row.

        The default data are the recorded ones with aligned channels.
        """
        fixed = {**structure.fixed, **self.reported.at_bound}
        bare = replace(structure, fixed=fixed)
        return least_squares_start(bare, data or self._aligned_data, self.filter_rate)[1]

    @cached_property
    def _full_rows(self) -> tuple[RowFit, ...]:
        """Rows of the full model in least squares."""
        return self.least_squares(self.full.structure).rows

    @cached_property
    def _aligned_data(self) -> Data:
        """All data with the channels' delays corrected."""
        structure, delays = self.reported.structure, self.reported.delays
        most = self.reported.data.largest_delay  # a diverging fit may ask for more
        late = (float(np.clip(delays.get(name, 0.0), -most, most)) for name in (INPUT, LINK))
        alignment = given_alignment(structure.timing.hold, *late)
        whole = self.recordings.whole
        timely = [with_velocities(aligned(recording, alignment)) for recording in whole]
        return data_of(structure.joint, timely, self.recordings.groups)

    @cached_property
    def scales(self) -> dict[str, float]:
        """Size at which a coefficient alone makes its row's acceleration; for delays the margin."""
        sizes = row_sizes(self._full_rows)
        scales = {name: 1.0 / size for name, size in sizes.items() if size > 0.0}
        delays = self.full.structure.timing.sought
        return scales | dict.fromkeys(delays, self.full.data.margin)

    @cached_property
    def one_way(self) -> dict[str, dict[str, float]]:
        """Dry frictions that the log cannot show, with their equivalents in other coefficients."""
        return one_way_frictions(self._full_rows, self.reported.names, THRESHOLDS.lost_share)

    def unexcited(self, lost_share: float) -> set[str]:
        """Return coefficients that the motion does not determine, with gravity as if in the model.

        These are all coefficients if the fit did not converge.
        """
        if not self.reported.converged:
            return {*self.reported.names}
        structure, full = self.choice.structure, self.choice.full
        gravity = frozenset(coefficients_of("gravity")) - full.absent
        heavy = replace(structure, absent=structure.absent - gravity)
        noisier = self._aligned_data.with_noise(_NOISE_SEED)
        independent = max(1.0, self.filter_rate * noisier.duration)
        pairs = zip(
            self.least_squares(heavy).rows, self.least_squares(heavy, noisier).rows, strict=True
        )
        rows = [without_noise(row, more, independent) for row, more in pairs]
        return {*unexcited(rows, self.reported.by_name, lost_share)}

    @property
    def residual_excess(self) -> dict[str, float]:
        """Root mean square of each position's residual over its sensor's noise."""
        reported = self.reported
        ratios = reported.minimum.noise(reported.problem) / reported.data.noise
        rows = [row.name for row in reported.problem.unknowns.system.rows]
        names = ["motor" if name == "rigid" else name for name in rows]
        return {f"{name}_position": float(r) for name, r in zip(names, ratios, strict=True)}


def final_fits(
    choice: Choice,
    whole: Data,
    recordings: SplitRecordings,
    filter_rate: float | Literal["auto"],  # in 1/s
    thresholds: Thresholds,
    *,
    insist: bool,
) -> FinalFits:
    """Fit the chosen structure and the full model to all data.

    If the fit fails, `insist` on another start; without it `ConvergenceError` is raised at once.
    """
    whole = replace(whole, refinement=choice.fitted.data.refinement)
    reported, lengths_fitted = _reported(choice, whole, insist=insist)
    joint = reported.structure.joint  # with the constants of shapes fitted to all data
    structure = replace(choice.structure, joint=joint)
    choice = replace(choice, structure=structure, full=replace(choice.full, joint=joint))
    error = model_error(reported, lengths_fitted, thresholds)
    rate = suited_rate(reported, filter_rate)
    full = _full(choice, reported)
    driving = driving_frictions(reported, thresholds)
    return FinalFits(choice, recordings, reported, full, rate, lengths_fitted, error, driving)


def with_doubts(fits: FinalFits, delay_in_doubt: bool, thresholds: Thresholds) -> Estimate:
    """Return the estimate with all doubts in its covariance."""
    reported, error = fits.reported, fits.error
    estimate = with_free_width(widened(reported, error), reported)
    estimate = estimate.widened(hidden_covariance(fits))
    estimate = estimate.widened(hold_covariance(reported, fits.choice.by_length.tied))
    estimate = estimate.widened(stand_in_covariance(reported, error, thresholds))
    estimate = estimate.widened(driving_covariance(reported, fits.driving))
    return estimate.widened(confused_covariance(estimate)) if delay_in_doubt else estimate


def _reported(choice: Choice, whole: Data, *, insist: bool) -> tuple[Fitted, list[Fitted]]:
    """Fit the structure to all data; return the fit to report, and the fits over all lengths."""
    structure, duration = choice.structure, choice.duration
    start = {**structure.timing.delays, **reflected(choice.fitted.by_name)}
    try:
        fitted, lengths_fitted = fit_to(structure, whole, start, duration)
    except ConvergenceError:
        if not insist:
            raise
        # The chosen values may be far off, as where the input acts only in the held-out end.
        begun = first_fits(structure, whole, lengths(whole, duration))[-1]
        fitted, lengths_fitted = fit_to(structure, whole, begun.by_name, duration)
    last = settled(fitted)
    return last, [last if one is fitted else one for one in lengths_fitted]


def _full(choice: Choice, reported: Fitted) -> Fitted:
    """Fit the model with all usual terms, for intervals of removed ones."""
    # It takes the same integration steps as the reported fit, so differences come from terms alone.
    shapes = choice.structure.joint.shapes & choice.structure.absent
    usual = replace(
        choice.full,
        absent=choice.full.absent | shapes,
        fixed={**choice.full.fixed, **reported.at_bound},
    )
    return fit_like(usual, reported) or expanded(usual, reported)


def hidden_covariance(fits: FinalFits, certain: Collection[str] = ()) -> FloatArray:
    """Return the covariance, shape (k, k), of the reported values from removed terms.

    A term that the log does not show may still exist. If the log cannot distinguish it from other
    terms, these may have taken its place. A priori a term is absent with odds o = 1; if present, it
    has about the size of its row's acceleration, τ. With its estimate x ± s next to the reported
    model,

        P(present) = 1 / (1 + o sqrt(1 + τ²/s²) exp(-½ x²/s² τ²/(s² + τ²)))

    (Bayes factor of a normal prior). A present term moves the others along the quadratic form of
    the fit. A term that the log would show well, but does not, adds nothing. A term that the log
    cannot show adds half its prior mean square. For `certain` terms P = 1. Nine of ten drives have
    a friction or damping of some 5 % of the acceleration. So for these a second prior has o = 1/9
    and such a τ, and the larger mean square counts.
    """
    reported, full, scales = fits.reported, fits.full, fits.scales
    names = list(full.names)
    kept = [names.index(name) for name in reported.names if name in names]
    places = [i for i, name in enumerate(reported.names) if name in names]
    added = np.zeros((len(reported.names), len(reported.names)))
    information = full.information
    values = full.values + full.minimum.reduced.values_step
    part = information[np.ix_(kept, kept)]
    inverse, _ = scaled_inverse(part, np.sqrt(np.maximum(np.diag(part), 0.0)))
    for i, name in enumerate(names):
        scale = scales.get(name, scales.get(name.partition("[")[0], 0.0))
        if i in kept or scale <= 0.0:
            continue
        if (parts := fits.one_way.get(name)) is not None:
            shift = np.array([parts.get(other, 0.0) for other in reported.names])
            added += _mean_square(0.0, np.inf, scale, absence=1.0) * np.outer(shift, shift)
            continue
        considered = np.isin(np.arange(len(names)), [*kept, i])
        place = int(np.count_nonzero(considered[:i]))
        # A difference of informations would lose the remainder to rounding.
        least = least_with(considered, information, values)
        variance = np.inf if least.free[place] else float(least.inverse[place, place])
        # The deviation next to the reported model, for correlated residuals.
        deviation = float(np.fmax(full.scatter[i], 1.0) * np.sqrt(variance))
        seen = float(least.values[place]), deviation
        base = name.partition("[")[0]
        mean_square = _mean_square(*seen, scale, absence=0.0 if base in certain else 1.0)
        if base in DISSIPATIVE:
            usual = _mean_square(*seen, _FRICTION * scale, absence=_FRICTIONLESS)
            mean_square = max(mean_square, usual)
        shift = inverse @ information[kept, i]
        added[np.ix_(places, places)] += mean_square * np.outer(shift, shift)
    return added


def _mean_square(value: float, deviation: float, scale: float, *, absence: float) -> float:
    """Return the posterior mean square of a term from the prior odds of its absence."""
    if not np.isfinite(deviation):
        return scale**2 / (1.0 + absence)
    both = deviation**2 + scale**2
    shrunk = scale**2 / both
    ratio = np.sqrt(both) / deviation * np.exp(-0.5 * (value / deviation) ** 2 * shrunk)
    mean, variance = value * shrunk, deviation**2 * shrunk
    return (mean**2 + variance) / (1.0 + absence * float(ratio))
