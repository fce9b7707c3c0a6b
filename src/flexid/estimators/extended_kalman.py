"""Extended Kalman filter for states and coefficients together: for comparison.

The coefficients are states that hardly change. Mean and transition over an interval are the
model's own motion and its exact derivatives, as in prediction error; the corrections are scalar,
in Joseph's form. It needs the noise, and starting values near enough: far from the truth it
converges to something else, which is why least squares starts and checks it here.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import ModuleType

import numpy as np

from flexid.arrays import FloatArray
from flexid.errors import SettingError
from flexid.estimators.beside_least_squares import (
    STARTED,
    BesideLeastSquares,
    samples_in,
    state_layout,
)
from flexid.estimators.online import start_values
from flexid.estimators.recursive_least_squares import (
    least_squares_observer,
    recursive_least_squares,
)
from flexid.kernels.store import load_kernel
from flexid.models.parametric_system import ParametricSystem
from flexid.recording.recording import Hold

_START_SPREAD = 0.5  # standard deviation of the starting values, relative
_EFFECT = 0.05  # and what moves the row's acceleration by this part, for those about zero
_START_VELOCITY = 10.0  # rad/s: standard deviation of a velocity of which nothing is known
_CHECK = 1.0  # s from one comparison with least squares to the next
_FEWEST = 20  # samples between comparisons at least


@dataclass(frozen=True, eq=False)
class ExtendedKalmanFilter(BesideLeastSquares):
    """The filter with its noise; made by `extended_kalman_filter`."""

    _kernel: ModuleType
    _settings: FloatArray

    def init(self, values: Mapping[str, float] | None = None) -> FloatArray:
        """State before the first sample.

        Parameters
        ----------
        values : mapping of str to float, optional
            A start for every coefficient, with which it runs at once; without it, it waits for
            least squares.

        Returns
        -------
        array
            The state, packed.

        Raises
        ------
        SettingError
            If a name is no coefficient of the model, or a value is not finite.
        """
        state = super().init(values)
        start = start_values(self.system, values)
        if np.all(start != 0.0):
            parts = self._parts(state)
            self._start(parts, start, _START_SPREAD * np.abs(start))
            parts["progress"][STARTED] = 1.0
        return state

    def standard_deviations(self, state: FloatArray) -> FloatArray:
        """Standard deviations by the filter's own covariance, shape (n_coefficients,).

        They are right if noise and model are those of the filter. Before it has started, those
        of least squares.
        """
        parts = self._parts(state)
        if not parts["progress"][STARTED]:
            return self.least_squares.standard_deviations(parts["least_squares"])
        variances = np.diag(self._covariance(parts))[self._kernel.N_STATES :]
        return np.sqrt(np.maximum(variances, 0.0))

    def _values(self, parts: np.ndarray) -> FloatArray:
        return parts["filter"][self._kernel.N_STATES : self._kernel.SIZE]

    def _covariance(self, parts: np.ndarray) -> FloatArray:
        size = self._kernel.SIZE
        return parts["filter"][self._kernel.COVARIANCE_AT :].reshape(size, size)

    def _begin(self, parts: np.ndarray) -> None:
        beside = parts["least_squares"]
        values = self.least_squares.coefficients(beside)
        spread = _START_SPREAD * np.abs(values) + _EFFECT * self.least_squares.effects(beside)
        self._start(parts, values, spread)

    def _start(self, parts: np.ndarray, values: FloatArray, spread: FloatArray) -> None:
        parts["filter"][:] = 0.0
        self._values(parts)[:] = values
        places = np.arange(self._kernel.N_STATES, self._kernel.SIZE)
        self._covariance(parts)[places, places] = spread**2

    def _run(self, parts: np.ndarray, samples: FloatArray, coefficients: FloatArray) -> None:
        if parts["progress"][STARTED]:
            self._kernel.run(parts["filter"], samples, self._settings, coefficients)

    def _break_off(self, parts: np.ndarray) -> None:
        parts["filter"][self._kernel.STARTED_AT] = 0.0  # the next sample gives a state anew

    def _finish_block(self, parts: np.ndarray) -> None:
        parts["progress"][STARTED] = 1.0


def extended_kalman_filter(
    system: ParametricSystem,
    sample_time: float,
    position_noise: float,
    velocity_noise: float | None = None,
    hold: Hold = "linear",
    acceleration_noise: float = 3e-3,
    drift: float = 3e-5,
    filter_rate: float = 20.0,
) -> ExtendedKalmanFilter:
    """Build the filter.

    Parameters
    ----------
    system : ParametricSystem
        The model.
    sample_time : float
        Time between samples in s: short enough for one step of Runge-Kutta 4.
    position_noise : float
        Standard deviation of the measured coordinates, in their unit.
    velocity_noise : float, optional
        Standard deviation of the measured velocities; without it, samples are without velocities.
    hold : {"linear", "zero"}, optional
        Whether the inputs run linearly between samples or are constant until the next one.
    acceleration_noise : float, optional
        Root of the density of a white acceleration that disturbs every row, rad/s^2/sqrt(Hz).
        Without any, the filter trusts its model too much and is lost.
    drift : float, optional
        Relative random walk of the coefficients, 1/sqrt(s).
    filter_rate : float, optional
        λ in 1/s of the least squares beside it, where there are no velocities.

    Returns
    -------
    ExtendedKalmanFilter

    Raises
    ------
    SettingError
        If a setting is out of its range.
    """

    def build() -> str:
        from flexid.derivation.sensitivities import sensitivity_functions

        return sensitivity_functions(system, "Extended Kalman filter")

    for name, value in (
        ("position noise", position_noise),
        ("velocity noise", 1.0 if velocity_noise is None else velocity_noise),
        ("acceleration noise", acceleration_noise),
        ("drift", drift),
    ):
        if not (np.isfinite(value) and value > 0.0):
            raise SettingError(name, f"{value} is no noise: give a positive number")
    if velocity_noise is None:
        beside = recursive_least_squares(system, sample_time, filter_rate, hold)
    else:
        beside = least_squares_observer(system, sample_time, hold)
    templates = ["bound", "runge_kutta", "dry_motion", "extended_kalman"]
    kernel = load_kernel("extended_kalman", [system.digest], build, templates)
    velocity = 0.0 if velocity_noise is None else velocity_noise
    settings = [sample_time, float(hold == "zero"), float(velocity_noise is not None)]
    settings += [position_noise, velocity, acceleration_noise, drift, _START_VELOCITY]
    array = np.array([*settings, *system.constants.values()], dtype=np.float64)
    layout = state_layout(beside, {"filter": kernel.FILTER_SIZE})
    block = max(_FEWEST, samples_in(_CHECK, sample_time, 1, "sample time"))
    return ExtendedKalmanFilter(beside, block, layout, kernel, array)
