"""The skew between the two encoders of a KUKA KR300, from its logs alone."""

import pytest

from flexid.identification.alignment import aligned, estimate_alignment
from flexid.recording import read_log

GEAR = {1: 256.9, 2: 267.4, 3: 252.3}


@pytest.fixture(
    scope="module",
    params=[(log, axis) for log in "AB" for axis in GEAR],
    ids=lambda axis_of_log: f"{axis_of_log[0]}{axis_of_log[1]}",
)
def found(request, shared_data, tmp_path_factory):
    """Return one axis of one log, and how it lies in time; its torque is that before the gear."""
    log, axis = request.param
    columns = tmp_path_factory.mktemp("kuka") / "columns.toml"
    columns.write_text(
        f"""
        time = "t_s"
        link_position = {{ column = "a{axis}_q_link_deg", unit = "deg" }}
        motor_position = {{ column = "a{axis}_q_mot_deg", unit = "deg" }}
        motor_torque = {{ column = "a{axis}_tau_mot_Nm", scale = {GEAR[axis]}, unit = "N m" }}
        """
    )
    pieces = read_log(shared_data / "kr300" / f"kr300_{log}.csv", columns).pieces
    return pieces, estimate_alignment(pieces)


def test_skew_is_found(found):
    """Assert that each axis's link encoder is found 3 ms late, zero being out of the question."""
    skew = found[1].link_delay
    assert skew.status == "found"
    assert skew.value == pytest.approx(3.0e-3, abs=0.15e-3)
    assert 2e-3 < skew.interval[0] < 3.0e-3 < skew.interval[1] < 3.5e-3


def test_most_of_the_deflection_goes(found):
    """Assert that aligning the encoders removes more than two thirds of the deflection."""
    pieces, alignment = found
    for piece in pieces:
        assert aligned(piece, alignment).deflection.std() < piece.deflection.std() / 3


def test_deflection_is_in_doubt(found):
    """Assert that another skew in the interval could make much of the deflection that is left."""
    assert found[1].deflection_doubt > 0.25


def test_input_delay_is_not_claimed(found):
    """Assert that a torque balance that leaves percents unexplained tells no delay of the input."""
    assert found[1].input_delay.value == 0.0
