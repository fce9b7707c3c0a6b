"""A deflection of the wrong sign is found out and named."""

from dataclasses import replace

import pytest
from made_joint import log, made

from flexid.estimators.channel_timing import Timing
from flexid.identification.full_model.model import Structure
from flexid.identification.full_model.starting import mirrored, turned_round
from flexid.identification.identify import identify
from flexid.identification.preparation.joint import Kind, joint_of
from flexid.identification.preparation.settings import Settings
from flexid.identification.vocabulary.thresholds import THRESHOLDS
from flexid.models.flexible_joint import PAPER_TERMS
from flexid.recording.velocities import with_velocities


@pytest.fixture(scope="module")
def right():
    """A drive whose deflection was measured."""
    return replace(made(3, 6.0), link_from_deflection=True)


def found(recording, model: Kind = "flexible"):
    """Whether the deflection is held to be turned round."""
    joint = joint_of(model)
    structure = Structure(joint, frozenset(joint.shapes), Timing("linear", {}))
    recordings = [with_velocities(recording)]
    return turned_round(structure, recordings, (0,), THRESHOLDS.mirrored_share)


@pytest.mark.parametrize("model", ["flexible", "link"])
def test_only_the_wrong_sign_is_found(right, model):
    """Assert that it is found of the deflection turned round, with and without an input.

    A link's own encoder has no such sign, nor has a joint that is not moved.
    """
    assert found(mirrored(right), model)
    still = replace(made(4, 6.0, size=1e-9), link_from_deflection=True)
    encoder = replace(mirrored(right), link_from_deflection=False)
    assert not any(found(other, model) for other in (right, encoder, still, mirrored(still)))


def test_the_warning_names_the_remedy(right):
    """Assert that an identification says so, and what to write."""
    settings = Settings(terms=PAPER_TERMS, hold="linear", input_delay=0.0, link_delay=0.0)
    found = identify([log(mirrored(right))], settings)
    (warning,) = (w for w in found.warnings if "deflection has the" in w)
    assert "scale = -1" in warning
