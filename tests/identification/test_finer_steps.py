"""Fits to fine encoders take shorter steps, from the longest segments of the full model on."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from made_joint import COEFFICIENTS, data, log, made, structure

import flexid.identification.estimation.final_fits as final
import flexid.identification.full_model.fitting as fitting
from flexid.estimators.gauss_newton import MOST, refinement
from flexid.identification.estimation.final_fits import FinalFits
from flexid.identification.full_model import fits_by_length
from flexid.identification.full_model.fitting import (
    fit_by_length,
    fit_to,
    lengths,
    refit,
    with_steps_refined,
)
from flexid.identification.full_model.model import FINE, ROUGH, Fitted
from flexid.identification.identify import identify
from flexid.identification.preparation.settings import Settings
from flexid.recording.recording import Recording

TERMS = ("gravity", "motor_viscous", "motor_coulomb")
STIFF = {"joint_stiffness": 1500.0, "motor_coulomb_up": 2.0, "motor_coulomb_down": 2.0}
FINE_NOISE, COARSE_NOISE = 1e-6, 1e-3  # rad

STRUCTURE = structure(*TERMS, hold="zero")
START = {**COEFFICIENTS, "theta2": 1500.0, "alpha1": 5000.0, "alpha_coulomb": 2.0 / 0.3}


def recorded(noise: float) -> Recording:
    """Six seconds with dry friction."""
    return made(4, 6.0, noise=noise, held=True, **STIFF)


@cache
def by_length(noise: float) -> tuple[Fitted, ...]:
    """Fits to them over segments of growing length."""
    own = data(recorded(noise))
    return tuple(fit_by_length(STRUCTURE, own, START, lengths(own)))


def test_fine_encoders_want_shorter_steps():
    """Assert that a fit ends in steps whose error is negligible, and does not begin with them.

    What the noise of coarse ones hides is not computed.
    """
    assert {fit.data.refinement for fit in with_steps_refined(by_length(COARSE_NOISE))} == {1}
    found = by_length(FINE_NOISE)
    times = refinement(found[-1].problem, found[-1].minimum)
    assert times > 1
    last = with_steps_refined(found)[-1]
    segments, states = last.problem.segments, last.minimum.point.initial_states
    fits = [
        refit(STRUCTURE, last.data, last.by_name, segments, tolerance, states)
        for tolerance in (FINE, ROUGH)
    ]
    assert [f.problem.substeps // last.problem.substeps for f in fits] == [times, 1]
    assert refinement(fits[0].problem, fits[0].minimum) == 1


def test_holds_are_compared_in_equal_steps(monkeypatch: pytest.MonkeyPatch):
    """Assert that a rival hold's longer steps do not pass for a doubt about the hold."""
    last = with_steps_refined(by_length(FINE_NOISE))[-1]
    segments, states = last.problem.segments, last.minimum.point.initial_states
    fine = refit(STRUCTURE, last.data, last.by_name, segments, FINE, states)
    # The same hold, as it is.
    monkeypatch.setattr(fits_by_length, "held_otherwise", lambda *_: last)
    apart = np.sqrt(np.diag(fits_by_length.hold_covariance(fine, ("zero",)))) / fine.unit_deviations
    assert np.abs((last.values - fine.values) / fine.unit_deviations).max() > 1.0
    assert apart.max() < 0.05


def test_other_data_are_asked_again():
    """Assert that a fit to data that want shorter steps than it began with ends in these."""
    fitted, lengths_fitted = fit_to(STRUCTURE, data(recorded(FINE_NOISE)), START, 1.0)
    assert fitted.data.refinement > 1
    assert refinement(fitted.problem, fitted.minimum) == 1
    assert [one_length for one_length in lengths_fitted if one_length is fitted]
    beyond = [one_length for one_length in lengths_fitted if one_length.duration > fitted.duration]
    assert {one_length.data.refinement for one_length in beyond} == {fitted.data.refinement}


@pytest.mark.parametrize(("taken", "wanted", "times"), [(1, 3, 3), (3, 3, MOST), (2, 1, 2)])
def test_steps_are_asked_for_once(
    taken: int, wanted: int, times: int, monkeypatch: pytest.MonkeyPatch
):
    """Assert that they multiply up to a limit, and that nothing is fitted again for the same."""
    asked = []
    monkeypatch.setattr(fitting, "refinement", lambda *_: asked.append(None) or wanted)
    last = by_length(COARSE_NOISE)[-1]
    last = replace(last, data=replace(last.data, refinement=taken))
    own = fitting.in_own_steps(last)
    assert (own.data.refinement, len(asked)) == (times, 1)
    assert (own is last) == (times == taken)


@pytest.mark.parametrize("refined", [False, True])
def test_report_and_rivals_take_the_same_steps(
    refined: bool, monkeypatch: pytest.MonkeyPatch, fits_seen: list[FinalFits]
):
    """Assert that the report is fitted in steps as fine as chosen or finer, all terms as it is."""
    times = []

    def watched(structure, data, *rest):
        times.append(data.refinement)
        return fit_to(structure, data, *rest)

    monkeypatch.setattr(final, "fit_to", watched)
    if not refined:
        monkeypatch.setattr(fits_by_length, "with_steps_refined", tuple)
    given = Settings(terms=TERMS, hold="zero", input_delay=0.0, link_delay=0.0)
    identify([log(recorded(FINE_NOISE))], given)
    (found,) = fits_seen
    assert (found.choice.fitted.data.refinement > 1) == (min(times) > 1) == refined
    assert found.reported.data.refinement > 1
    assert found.full.problem.substeps == found.reported.problem.substeps
