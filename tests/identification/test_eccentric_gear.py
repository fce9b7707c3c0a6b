"""An eccentric gear, whose second order follows from the first: to the report and beyond it."""

from dataclasses import replace

import numpy as np
import pytest
from made_joint import JOINT, data, log, made

from flexid.errors import SettingError
from flexid.estimators.channel_timing import Timing
from flexid.estimators.unknowns import Unknowns
from flexid.exports.request import request_of_identification
from flexid.identification.full_model.model import Structure
from flexid.identification.full_model.starting import smooth_unknowns
from flexid.identification.identify import identify
from flexid.models.flexible_joint import PAPER_TERMS, SQUARES, TIES
from flexid.stored_estimates.structure import structure_of, values_of
from flexid.streaming.options import StreamChannels, options_of_stream

SIZE, PHASE = 0.02, 0.6  # rad
CHANNELS = StreamChannels("flexible", "N m", False, ())


@pytest.fixture(scope="module")
def recording():
    """Return a motion with such a gear."""
    return made(3, 12.0, eccentricity=SIZE, eccentricity_phase=PHASE)


@pytest.fixture(scope="module")
def found(recording):
    """Return what is identified of it, told nothing."""
    return identify([log(recording)])


def test_what_follows_is_reported_as_it_follows(found):
    """Assert that a coefficient that is a square is one, and that its model is built of it."""
    values = {name: c.value for name, c in found.coefficients.items()}
    for name, (a, b, d) in TIES.items():
        if name in values:
            assert values[name] == pytest.approx(values[a] * values[b] / values[d], rel=1e-9)
    assert values.keys() >= SQUARES
    again = structure_of(found, values_of(found, 0))
    assert set(again.unknowns(()).names) == {c for c in values if c not in TIES}


def test_least_squares_seeks_no_square(recording):
    """Assert that columns which nothing but a square tells apart are not sought."""
    joint = JOINT.scaled(data(recording).samples).with_shapes_in_least_squares
    structure = Structure(joint, frozenset(), Timing("cubic"))
    unknowns = smooth_unknowns(structure, (0,))
    assert not SQUARES & {*unknowns.names}
    assert {"alpha_ecc_sine", "alpha_ecc_cosine"} <= {*unknowns.names}


def test_what_is_exported_knows_the_squares(found):
    """Assert that an exported estimator has them in its known part, with the estimate's values.

    None is made of what has no value, and what an estimate knows of a term goes with the term.
    """
    source = request_of_identification(found)
    assert not SQUARES & {*source.system.coefficients}
    assert source.system.constants.keys() >= SQUARES
    assert Unknowns(source.system).names == source.system.coefficients
    assert not options_of_stream({"terms": PAPER_TERMS}, found, CHANNELS, 2e-3).given
    none = replace(found.coefficients["alpha_ecc_product"], value=np.nan)
    coefficients = found.coefficients | {"alpha_ecc_product": none}
    with pytest.raises(SettingError, match="alpha_ecc_product"):
        request_of_identification(replace(found, coefficients=coefficients))
