"""filterpy's extended Kalman filter for states and coefficients, as a user would write it."""

from math import cos, sin

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter

from flexid.arrays import FloatArray

_MEASURED = np.eye(4, 8)


class JointFilter(ExtendedKalmanFilter):
    """Filter for the states x1 ... x4, all measured, and θ1, θ2, α1, α2 of the flexible joint.

    The prediction of the state, which a user of filterpy may replace, is one Runge-Kutta step.
    The covariance uses the Jacobian of an Euler step.

    Parameters
    ----------
    step : float
        Sample time in s.
    beta1 : float
        Known input gain 1/Jr.
    noise : (float, float)
        True standard deviations of positions and velocities, in rad and rad/s.
    guess : (4,) array
        Initial coefficients, whose standard deviations equal their values.
    """

    def __init__(self, step: float, beta1: float, noise: tuple[float, float], guess: FloatArray):
        super().__init__(dim_x=8, dim_z=4)
        self.step, self.beta1 = step, beta1
        variances = np.tile(np.square(noise), 2)
        self.x = np.concatenate((np.zeros(4), guess))
        self.P = np.diag(np.concatenate((100.0 * variances, np.square(guess))))
        self.Q = np.diag(np.concatenate((1e-4 * variances, np.zeros(4))))
        self.R = np.diag(variances)

    def advance(self, measurement: FloatArray, torque: float) -> None:
        """Process a sample: predict over the interval with its mean torque, then correct."""
        self.predict(torque)  # type: ignore[arg-type] - filterpy's default suggests an int
        self.update(measurement, lambda _: _MEASURED, lambda x: x[:4])

    def predict_x(self, u: float = 0.0) -> None:
        """Replace x by its prediction and F by the Jacobian."""
        x, h = self.x, self.step
        self.F = self._jacobian()
        k1 = self._rates(x, u)
        k2 = self._rates(x + 0.5 * h * k1, u)
        k3 = self._rates(x + 0.5 * h * k2, u)
        k4 = self._rates(x + h * k3, u)
        self.x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)

    def _rates(self, x: FloatArray, u: float) -> FloatArray:
        x1, x2, x3, x4, theta1, theta2, alpha1, alpha2 = x.tolist()
        twist = x1 - x3
        link = -theta1 * sin(x1) - theta2 * twist
        motor = alpha1 * twist - alpha2 * x4 + self.beta1 * u
        return np.array([x2, link, x4, motor, 0.0, 0.0, 0.0, 0.0])

    def _jacobian(self) -> FloatArray:
        x1, _, x3, x4, theta1, theta2, alpha1, alpha2 = self.x.tolist()
        h, twist = self.step, x1 - x3
        F = np.eye(8)
        F[0, 1] = F[2, 3] = h
        F[1, 0] = -h * (theta1 * cos(x1) + theta2)
        F[1, 2] = h * theta2
        F[1, 4] = -h * sin(x1)
        F[1, 5] = -h * twist
        F[3, 0] = h * alpha1
        F[3, 2] = -h * alpha1
        F[3, 3] -= h * alpha2
        F[3, 6] = h * twist
        F[3, 7] = -h * x4
        return F
