"""The control law (11): its feedforward, and the relative degree of the joint."""

import sympy as sp


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
