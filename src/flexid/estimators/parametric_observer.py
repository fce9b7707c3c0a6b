"""The parametric observer of Huang (2003), sampled, as an estimator.

In continuous time the estimates obey p' = G r (v' - rᵀp - k) exactly, without v' being known
(eqs. (2)-(3)). Over a sampling interval the integral of r v' is r̄ Δv with the regressor r̄ at its
middle, so the sampled form needs neither accelerations nor the closed-form immersion. It is stable
at any gain; a gain that is too high still turns velocity noise into noise of the estimates.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import ModuleType

import numpy as np

from flexid.errors import SettingError
from flexid.estimators.samples import FloatArray, Samples
from flexid.kernels.store import load_kernel, template
from flexid.models.parametric_system import ParametricSystem
from flexid.recording.recording import Hold


@dataclass(frozen=True, eq=False)
class ObserverHistory:
    """What a replay returns.

    Parameters
    ----------
    coefficients : array, shape (n, n_coefficients)
        Estimates after each sample.
    innovations : array, shape (n, n_rows)
        Change of each velocity over the interval less its prediction, rad/s; NaN at the very first
        sample, which has no interval before it.
    state : array
        State after the last sample; a stream goes on from here.
    """

    coefficients: FloatArray
    innovations: FloatArray
    state: FloatArray


@dataclass(frozen=True, eq=False)
class ParametricObserver:
    """The observer with its gains; made by `parametric_observer`.

    Parameters
    ----------
    system : ParametricSystem
        The model.
    gains : array, shape (n_coefficients,)
        Diagonal of G; in the paper c1 for each coefficient of the link, c2 for each of the motor.
    sample_time : float
        Time between samples in s.
    hold : {"linear", "zero"}
        Hold of the inputs between samples.
    """

    system: ParametricSystem
    gains: FloatArray
    sample_time: float
    hold: Hold
    _kernel: ModuleType
    _settings: FloatArray

    def init(self, values: Mapping[str, float] | None = None) -> FloatArray:
        """State before the first sample.

        Parameters
        ----------
        values : mapping of str to float, optional
            Initial estimates; a coefficient that is not named starts from 0.

        Returns
        -------
        array
            The state, packed. `coefficients` reads the estimates from it.

        Raises
        ------
        SettingError
            If a name is no coefficient of the model.
        """
        state = np.zeros(self._kernel.STATE_SIZE)
        names = self.system.coefficients
        for name, value in (values or {}).items():
            if name not in names:
                raise SettingError(
                    "initial estimates", f"{name!r} is no coefficient; known are {', '.join(names)}"
                )
            state[1 + names.index(name)] = value
        return state

    def step(self, state: FloatArray, sample: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Take in one sample.

        Parameters
        ----------
        state : array
            From `init` or the step before; not changed.
        sample : array, shape (2 n_rows + n_inputs,)
            Float64: coordinate and velocity of each row in turn, then the inputs.

        Returns
        -------
        state : array
            The new state.
        innovation : array, shape (n_rows,)
            As in `ObserverHistory`.
        """
        return self._kernel.step(state, sample, self._settings)

    def replay(self, state: FloatArray, samples: FloatArray) -> ObserverHistory:
        """Take in many samples, exactly as `step` would one by one.

        Parameters
        ----------
        state : array
            From `init`, `step` or an earlier replay; not changed.
        samples : array, shape (n, 2 n_rows + n_inputs)
            One sample per row; `packed` makes them.

        Returns
        -------
        ObserverHistory
        """
        samples = np.ascontiguousarray(samples, dtype=np.float64)
        coefficients = np.empty((len(samples), len(self.system.coefficients)))
        innovations = np.empty((len(samples), len(self.system.rows)))
        last = self._kernel.replay(state, samples, self._settings, coefficients, innovations)
        return ObserverHistory(coefficients, innovations, last)

    def coefficients(self, state: FloatArray) -> FloatArray:
        """Estimates in a state, shape (n_coefficients,)."""
        return state[1 : 1 + len(self.system.coefficients)].copy()


def parametric_observer(
    system: ParametricSystem, gains: Mapping[str, float], sample_time: float, hold: Hold = "linear"
) -> ParametricObserver:
    """Build the observer of a model.

    Parameters
    ----------
    system : ParametricSystem
        The model; its constants have the values declared in it.
    gains : mapping of str to float
        A gain for each coefficient, or one for all coefficients of a row under the row's name: the
        paper's c1 and c2 are ``{"link": c1, "motor": c2}``.
    sample_time : float
        Time between samples in s.
    hold : {"linear", "zero"}, optional
        Whether the inputs run linearly between samples or are constant until the next one.

    Returns
    -------
    ParametricObserver

    Raises
    ------
    SettingError
        If a gain is missing or negative, or the sample time is not positive.
    """
    if not (np.isfinite(sample_time) and sample_time > 0.0):
        raise SettingError("sample time", f"{sample_time} is no time step: give seconds above 0")
    diagonal = np.array(
        [_gain(gains, row.name, name) for row in system.rows for name in row.coefficients]
    )
    constants = list(system.constants.values())
    settings = np.array([sample_time, float(hold == "zero"), *diagonal, *constants])
    return ParametricObserver(system, diagonal, sample_time, hold, _kernel(system), settings)


def suggest_gains(
    samples: Samples, system: ParametricSystem, convergence_rate: float = 1.0
) -> dict[str, float]:
    """Gains under which each row's error decays at about a given rate, were all else known.

    Each coefficient gets rate / (k mean r²), k the number of coefficients in its row, so that all
    weigh alike in r̄ᵀG r̄ whatever their units. Directions that the motion excites less decay more
    slowly, and may not decay within the record at all: see the condition number of the excitation.

    Parameters
    ----------
    samples : Samples
        Typical motion, with velocities.
    system : ParametricSystem
        The model.
    convergence_rate : float, optional
        In 1/s.

    Returns
    -------
    dict of str to float
        For `parametric_observer`. A regressor that is always zero gets gain 0.

    Raises
    ------
    SettingError
        If the samples have no velocities.
    """
    squares = np.empty(len(system.coefficients))
    constants = np.array(list(system.constants.values()), dtype=np.float64)
    _kernel(system).mean_squares(packed(samples), constants, squares)
    counts = [len(row.coefficients) for row in system.rows for _ in row.coefficients]
    return {
        name: convergence_rate / (count * square) if square > 0.0 else 0.0
        for name, count, square in zip(system.coefficients, counts, squares.tolist(), strict=True)
    }


def packed(samples: Samples) -> FloatArray:
    """Samples as the observer takes them, shape (n, 2 n_rows + n_inputs).

    Raises
    ------
    SettingError
        If the samples have no velocities.
    """
    if samples.velocities is None:
        raise SettingError(
            "velocities", "the parametric observer needs them: derive velocities first"
        )
    states = np.stack((samples.positions, samples.velocities), axis=2).reshape(len(samples), -1)
    return np.ascontiguousarray(np.concatenate((states, samples.inputs), axis=1))


def _gain(gains: Mapping[str, float], row: str, coefficient: str) -> float:
    gain = gains.get(coefficient, gains.get(row))
    if gain is None:
        raise SettingError("gains", f"there is none for {coefficient!r} nor for its row {row!r}")
    if not (np.isfinite(gain) and gain >= 0.0):
        raise SettingError("gains", f"{gain} for {coefficient!r} is no gain: give a number >= 0")
    return float(gain)


def _kernel(system: ParametricSystem) -> ModuleType:
    def build() -> str:
        from flexid.derivation.sampled_observer import sampled_observer_functions

        source = sampled_observer_functions(system, "Parametric observer, sampled")
        return source + "\n\n" + template("parametric_observer")

    return load_kernel("parametric_observer", [system.digest], build)
