"""Terms of the two joints, and what each leaves to be sought."""

import numpy as np
import pytest

from flexid.errors import SettingError
from flexid.identification.joint import flexible, rigid
from flexid.models.flexible_joint import COEFFICIENT_UNITS
from flexid.models.rigid_joint import RIGID_UNITS


@pytest.mark.parametrize("joint", [flexible(), flexible("motor_stiction"), rigid()])
def test_terms_and_what_is_always_there_make_the_system(joint):
    """Assert that each coefficient belongs to one term, or to the spring and the input's gain."""
    of_terms = [c for names in joint.terms.values() for c in names]
    always = ["theta2", "alpha1", "beta1"] if joint.kind == "flexible" else ["beta1"]
    assert sorted([*of_terms, *always]) == sorted(joint.system.coefficients)


def test_every_coefficient_has_a_unit():
    """Assert that no coefficient would come out without its unit."""
    assert set(COEFFICIENT_UNITS) >= {*flexible("motor_stiction").system.coefficients}
    assert set(RIGID_UNITS) == {*rigid().system.coefficients}


def test_terms_are_found_from_their_coefficients():
    """Assert that a term is named once, in the model's order, whichever coefficient is given."""
    found = flexible().terms_with(["alpha_damping", "theta_damping", "theta1", "theta2"])
    assert found == ("gravity", "joint_damping")


def test_terms_that_are_off_are_not_sought():
    """Assert that the paper's terms leave the paper's coefficients."""
    unknowns = flexible().unknowns(("gravity", "motor_viscous"), {})
    assert unknowns.names == ("theta1", "theta2", "alpha1", "alpha2", "beta1")


def test_offsets_are_sought_log_by_log():
    """Assert that two pieces of one log share an offset, and that another log has its own."""
    unknowns = flexible().unknowns(("link_offset",), {}, groups=(0, 0, 1))
    assert unknowns.names == ("theta2", "theta_offset[1]", "theta_offset[2]", "alpha1", "beta1")
    values = [unknowns.coefficients(np.arange(5.0), piece) for piece in range(3)]
    place = unknowns.system.coefficients.index("theta_offset")
    assert [v[place] for v in values] == [1.0, 1.0, 2.0]


def test_given_offset_holds_in_every_log():
    """Assert that a given offset is sought in no log."""
    unknowns = flexible().unknowns(("link_offset",), {"theta_offset": 0.5}, groups=(0, 1))
    assert unknowns.names == ("theta2", "alpha1", "beta1")
    place = unknowns.system.coefficients.index("theta_offset")
    assert unknowns.coefficients([1.0, 1.0, 1.0], 1)[place] == 0.5


def test_known_coefficient_of_a_term_that_is_off_is_refused():
    """Assert that a value which would have to be ignored is refused with its term."""
    with pytest.raises(SettingError, match="theta_cubic belongs to the term 'cubic_stiffness'"):
        flexible().unknowns(("gravity",), {"theta_cubic": 3.0})


def test_zero_may_be_given_for_a_term_that_is_off():
    """Assert that a coefficient given as zero and a term that is off do not contradict."""
    assert "theta_cubic" not in flexible().unknowns(("gravity",), {"theta_cubic": 0.0}).names


def test_deflection_is_the_third_channel():
    """Assert that a flexible joint is compared in link, motor and their difference."""
    channels = flexible().channels_of(np.array([[3.0, 1.0], [5.0, 4.5]]))
    np.testing.assert_allclose(channels, [[3.0, 1.0, 2.0], [5.0, 4.5, 0.5]])


def test_smoothing_of_friction_needs_no_other_kernel():
    """Assert that another Coulomb velocity changes a constant and nothing of the equations."""
    other = flexible().with_coulomb_velocity(0.01)
    assert other.system.constants["coulomb_velocity"] == 0.01
    assert other.system.digest == flexible().system.digest
