"""The equations of Huang (2003) in SymPy, written down apart from the library's own derivation."""

import sympy as sp

x1, x2, x3, x4, u = sp.symbols("x1 x2 x3 x4 u", real=True)
c1, c2 = sp.symbols("c1 c2", positive=True)
theta = sp.Matrix(sp.symbols("theta1 theta2", real=True))
alpha = sp.Matrix(sp.symbols("alpha1 alpha2", real=True))
beta1 = sp.Symbol("beta1", positive=True)
theta_hat = sp.Matrix(sp.symbols("thetahat1 thetahat2", real=True))
alpha_hat = sp.Matrix(sp.symbols("alphahat1 alphahat2", real=True))

# Eq. (4) in the form of eq. (1).
f = sp.Matrix([-sp.sin(x1), -(x1 - x3)])
phi = sp.Matrix([x1 - x3, -x4])
states = (x1, x2, x3, x4)
rates = (x2, theta.dot(f), x4, alpha.dot(phi) + beta1 * u)

# Eq. (5): what is added to y and z.
link_immersion = sp.Matrix([-c1 * x2 * sp.sin(x1), -c1 * (x1 - x3) * x2])
motor_immersion = sp.Matrix([c2 * (x1 - x3) * x4, -c2 * x4**2 / 2])


def along_motion(expression: sp.Matrix) -> sp.Matrix:
    """Return the time derivative of a function of the state along eq. (4)."""
    return expression.jacobian(states) * sp.Matrix(rates)


def link_error_rate(y_rate: sp.Matrix) -> sp.Matrix:
    """Return what eq. (5) and a given y' make of the rate of theta-hat, less eq. (7)'s."""
    wanted = -c1 * f * (f.T * (theta_hat - theta))
    return (y_rate + along_motion(link_immersion) - wanted).applyfunc(sp.expand)


def motor_error_rate(z_rate: sp.Matrix) -> sp.Matrix:
    """Return what eq. (5) and a given z' make of the rate of alpha-hat, less eq. (7)'s."""
    wanted = -c2 * phi * (phi.T * (alpha_hat - alpha))
    return (z_rate + along_motion(motor_immersion) - wanted).applyfunc(sp.expand)
