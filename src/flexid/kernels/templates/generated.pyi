# Signatures of the functions that `flexid.derivation` prints, for type checks of the templates. A
# kernel has only some of them; tests/kernels/test_store.py compares the arguments.

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

_Array = NDArray[np.float64]
_Numbers = tuple[float, ...]

LANES: int
N_BLOCKS: int
N_COEFFICIENTS: int
N_CONSTANTS: int
N_CORNERS: int
N_INPUTS: int
N_MEMORIES: int
N_OBSERVED: int
N_PARAMETERS: int
N_ROWS: int
N_STATES: int
ROW_STARTS: tuple[int, ...]
SAMPLE_SIZE: int
SIZE: int
STATE_SIZE: int
TRACKED: int
WIDTH: int

# Functions of a model.
def regressors(_x: _Array, _u: _Array, _c: _Array, _r: _Array, _k: _Array) -> None: ...
def acting(_p: _Array, _at: NDArray[np.int64], _on: _Array) -> None: ...
def state_rates(
    _x: _Array, _u: _Array, _m: _Array, _p: _Array, _c: _Array, _on: _Array, _dx: _Array
) -> None: ...
def corners(_x: _Array, _p: _Array, _c: _Array, _k: _Array) -> None: ...
def remember(_x: _Array, _start: _Array, _p: _Array) -> None: ...
def slopes(
    _x: _Array,
    _u: _Array,
    _du: _Array,
    _m: _Array,
    _p: _Array,
    _c: _Array,
    _on: _Array,
    _at: NDArray[np.int64],
    _delay: int,
    _a: _Array,
    _r: _Array,
) -> None: ...
def memory_slopes(
    _x: _Array, _start: _Array, _p: _Array, _at: NDArray[np.int64], _b: _Array, _q: _Array
) -> None: ...
def vary(
    _z: _Array,
    _n: int,
    _step: float,
    _a: _Array,
    _r: _Array,
    _b: _Array,
    _q: _Array,
    _d: _Array,
    _free: _Array,
) -> None: ...

# Functions of the template that follows `runge_kutta`.
rates_at: Callable[[_Array, float, Any, _Array], None]
recall: Callable[[_Array, _Array, Any], None]

# Functions of a closed loop.
def outputs(_t: float, _z: _Array, _p: _Array, _y: _Array) -> None: ...
def rates(_t: float, _z: _Array, _p: _Array, _dz: _Array) -> None: ...
def rates_and_jacobian(
    _t: float, _z: _Array, _p: _Array, _dz: _Array, _jacobian: _Array, _slope: _Array
) -> None: ...
def lane_rates(_w: _Array) -> None: ...
def lane_rates_and_outputs(_w: _Array) -> None: ...

# Functions of the observer and the loop that run sample by sample, on tuples.
def advance(
    _state: _Numbers, _sample: _Numbers, _settings: _Numbers
) -> tuple[_Numbers, _Numbers]: ...
def as_state(_array: _Array) -> _Numbers: ...
def as_states(_array: _Array, _n: int) -> _Numbers: ...
def as_sample(_array: _Array, _n: int) -> _Numbers: ...
def as_settings(_array: _Array) -> _Numbers: ...
def as_parameters(_array: _Array, _n: int) -> _Numbers: ...
def control(_t: float, _x: _Numbers, _p: _Numbers) -> tuple[_Numbers, float]: ...
def plant_rates(_x: _Numbers, _u: _Numbers, _p: _Numbers) -> _Numbers: ...
def moved(_x: _Numbers, _h: float, _d: _Numbers) -> _Numbers: ...
def averaged(_a: _Numbers, _b: _Numbers, _c: _Numbers, _d: _Numbers) -> _Numbers: ...
def clipped(_u: _Numbers, _limit: float) -> _Numbers: ...
def noisy(_x: _Numbers, _d: _Numbers, _position: float, _velocity: float) -> _Numbers: ...
def in_steps(_x: _Numbers, _step: float) -> _Numbers: ...
