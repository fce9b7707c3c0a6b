"""The control law (11): its feedforward, and what its readings do to the loop's poles."""

import numpy as np
import pytest
import sympy as sp
from numpy.typing import NDArray

k = 50.0
true_gravity, true_link, true_motor, true_friction, true_stiffness = 5.0, 1.0, 0.3, 0.1, 100.0
largest_link, largest_motor, smallest_stiffness = 1.4, 0.42, 60.0


def poles(a: int, b: int, c: int, gain: float = k) -> NDArray[np.complex128]:
    """Return the poles of eq. (4) under u_F of eq. (11), linearised about rest at qd = 0.

    The gains are k^a JlM/kem, k^b and k^c JrM. At qd = 0 the feedforward vanishes.
    """
    first = gain**a * largest_link / smallest_stiffness
    second = gain**b
    third = gain**c * largest_motor

    def rates(state: NDArray[np.float64]) -> NDArray[np.float64]:
        x1, x2, x3, x4 = state
        first_error = x2 + gain * x1
        motor_target = -first * first_error
        rate_target = -second * (x3 - motor_target)
        torque = -third * (x4 - rate_target)
        spring = true_stiffness * (x1 - x3)
        return np.array(
            [
                x2,
                (-true_gravity * np.sin(x1) - spring) / true_link,
                x4,
                (spring - true_friction * x4 + torque) / true_motor,
            ]
        )

    step = 1e-6
    columns = [(rates(step * unit) - rates(-step * unit)) / (2 * step) for unit in np.eye(4)]
    return np.linalg.eigvals(np.column_stack(columns)).astype(np.complex128)


@pytest.mark.parametrize(
    ("exponents", "largest"),
    [((1, 1, 0), 13.8), ((1, 1, 1), 22.7), ((1, 1, 3), 0.011), ((1, 2, 3), -60.0)],
)
def test_largest_real_part_of_the_poles(exponents: tuple[int, int, int], largest: float) -> None:
    """Assert the largest real part, in 1/s, of the closed loop's poles for each reading."""
    assert poles(*exponents).real.max() == pytest.approx(largest, rel=5e-3, abs=5e-4)


def test_smallest_edit_leaves_an_undamped_pair() -> None:
    """Assert that gains (1, 1, 3) leave a pair of poles that rings at 77 rad/s."""
    found = poles(1, 1, 3)
    ringing = found[np.argmax(found.real)]
    assert abs(ringing.imag) == pytest.approx(77.0, abs=0.5)


def test_smallest_edit_is_not_cured_by_a_larger_k() -> None:
    """Assert that with gains (1, 1, 3) the pair stays right of the axis from k = 15 on."""
    for gain in np.geomspace(15.0, 1000.0, 9):
        assert 0.0 < poles(1, 1, 3, gain).real.max() < 0.03


@pytest.mark.parametrize(("exponents", "slope"), [((1, 2, 3), -1.17), ((2, 2, 3), -1.0)])
@pytest.mark.parametrize("gain", [200.0, 400.0, 800.0])
def test_increasing_gains_keep_the_promise_of_arbitrarily_fast_errors(
    exponents: tuple[int, int, int], slope: float, gain: float
) -> None:
    """Assert that with k^2 in the second gain the slowest pole moves left in proportion to k.

    It does so whether or not the stray 2 near the first gain is read as a square.
    """
    assert poles(*exponents, gain).real.max() / gain == pytest.approx(slope, abs=0.01)


@pytest.mark.parametrize("exponents", [(1, 1, 0), (1, 1, 1)])
def test_constant_or_single_gains_grow_unstable_with_k(exponents: tuple[int, int, int]) -> None:
    """Assert that under the first two readings a larger k drives the poles to the right."""
    largest = [poles(*exponents, gain).real.max() for gain in np.geomspace(20.0, 1000.0, 9)]
    assert largest[0] > 1.0
    assert np.all(np.diff(largest) > 0)


def test_feedforward_is_the_torque_of_the_nominal_joint() -> None:
    """Assert that u_N = Jr w2N' + mu w2N + ke (w1N - qd), which puts Jr before the bracket."""
    time = sp.Symbol("t")
    gravity, link, motor, friction, stiffness = sp.symbols("mgl Jl Jr mu ke", positive=True)
    q = sp.Function("q")(time)
    q_1, q_2, q_3, q_4 = (q.diff(time, order) for order in range(1, 5))

    w1 = q + (gravity * sp.sin(q) + link * q_2) / stiffness
    w2 = q_1 + (gravity * sp.cos(q) * q_1 + link * q_3) / stiffness
    bracket = gravity * q_2 * sp.cos(q) - gravity * q_1**2 * sp.sin(q) + link * q_4
    rest = friction * w2 + gravity * sp.sin(q) + link * q_2

    assert sp.expand(w1.diff(time) - w2) == 0
    torque = motor * w2.diff(time) + friction * w2 + stiffness * (w1 - q)
    with_motor_inertia = motor * q_2 + motor / stiffness * bracket + rest
    without_motor_inertia = motor * q_2 + bracket / stiffness + rest
    assert sp.expand(torque - with_motor_inertia) == 0
    assert sp.expand(torque - without_motor_inertia) != 0


def test_feedforward_moves_the_exact_joint_along_the_reference() -> None:
    """Assert that x1 = qd, x3 = w1N solves eq. (4) under u_N where the parameters are exact."""
    time = sp.Symbol("t")
    gravity, link, motor, friction, stiffness = sp.symbols("mgl Jl Jr mu ke", positive=True)
    q = sp.Function("q")(time)
    w1 = q + (gravity * sp.sin(q) + link * q.diff(time, 2)) / stiffness
    torque = motor * w1.diff(time, 2) + friction * w1.diff(time) + stiffness * (w1 - q)

    link_row = link * q.diff(time, 2) + gravity * sp.sin(q) + stiffness * (q - w1)
    motor_row = motor * w1.diff(time, 2) - stiffness * (q - w1) + friction * w1.diff(time) - torque
    assert sp.expand(link_row) == 0
    assert sp.expand(motor_row) == 0


def test_link_angle_has_relative_degree_four() -> None:
    """Assert that the torque first enters the fourth derivative of x1: no zero dynamics."""
    x1, x2, x3, x4, u = states = sp.symbols("x1 x2 x3 x4 u")
    t1, t2, a1, a2, b1 = sp.symbols("theta1 theta2 alpha1 alpha2 beta1", positive=True)
    rates = sp.Matrix(
        [x2, -t1 * sp.sin(x1) - t2 * (x1 - x3), x4, a1 * (x1 - x3) - a2 * x4 + b1 * u]
    )
    output: sp.Expr = x1
    gains = []
    for _ in range(4):
        output = (sp.Matrix([output]).jacobian(states[:4]) * rates)[0]
        gains.append(sp.expand(output).coeff(u))
    assert gains == [0, 0, 0, t2 * b1]
