"""A deflection of the wrong sign is found out and named."""

from dataclasses import replace

import pytest
from made_joint import made

from flexid.estimators.channel_timing import Timing
from flexid.identification.full_model.model import Structure
from flexid.identification.full_model.starting import mirrored, turned_round
from flexid.identification.identify import identify
from flexid.identification.preparation.joint import Kind, joint_of
from flexid.identification.preparation.settings import Settings
from flexid.identification.vocabulary.thresholds import THRESHOLDS
from flexid.recording.recording import Log
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
    """Assert that it is found of the deflection turned round, with and without an input."""
    assert found(mirrored(right), model)
    assert not found(right, model)


def test_a_link_s_own_encoder_has_no_such_sign(right):
    """Assert that nothing is said where no deflection was measured."""
    assert not found(replace(mirrored(right), link_from_deflection=False))


def test_a_joint_that_is_not_moved_has_neither_sign(right):
    """Assert that noise alone speaks for no sign."""
    still = replace(made(4, 6.0, size=1e-9), link_from_deflection=True)
    assert not found(still)
    assert not found(mirrored(still))


def test_the_warning_names_the_remedy(right):
    """Assert that an identification says so, and what to write."""
    log = Log((mirrored(right),), (), "made", "0" * 64)
    settings = Settings(
        terms=("gravity", "motor_viscous"), hold="linear", input_delay=0.0, link_delay=0.0
    )
    (warning,) = (w for w in identify([log], settings).warnings if "deflection has the" in w)
    assert "scale = -1" in warning
