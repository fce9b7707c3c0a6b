"""Hand-written C of the sampled observer, compiled in several ways and called from Python."""

import ctypes
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np

from flexid.arrays import FloatArray

Replay = Callable[[], tuple[FloatArray, FloatArray]]
"""Function that processes all samples and returns estimates and innovations."""

SOURCE = Path(__file__).with_name("observer.c")

# -ffast-math is left out: it may reorder sums, so the algorithm would not be the same.
BUILDS = (
    ("-O2",),
    ("-O3",),
    ("-O3", "-fno-math-errno"),
    ("-O3", "-march=native"),
    ("-O3", "-march=native", "-fno-math-errno"),
    ("-O3", "-march=native", "-funroll-loops"),
)
"""Sets of flags for gcc."""


class _Estimate(ctypes.Structure):
    _fields_ = [(name, ctypes.c_double) for name in ("theta1", "theta2", "alpha1", "alpha2")]


def compile_replay(
    flags: tuple[str, ...],
    folder: Path,
    samples: FloatArray,
    step: float,
    beta1: float,
    gains: FloatArray,
) -> Replay:
    """Compile with gcc and bind to one record.

    Parameters
    ----------
    flags : tuple of str
        Flags for gcc.
    folder : Path
        Folder for the library.
    samples : (n, 5) array
        x1, x2, x3, x4, u, contiguous.
    step, beta1 : float
        Sample time in s; known input gain.
    gains : (4,) array
        One per coefficient.

    Returns
    -------
    callable
        Function that starts from zero estimates and fills new arrays at each call.
    """
    library = folder / f"observer{'_'.join(flags)}.so"
    command = [
        "gcc",
        "-std=c99",
        *flags,
        "-shared",
        "-fPIC",
        "-o",
        str(library),
        str(SOURCE),
        "-lm",
    ]
    subprocess.run(command, check=True)
    function = ctypes.CDLL(str(library)).replay
    pointer, number = ctypes.c_void_p, ctypes.c_double
    function.restype = None
    function.argtypes = [
        pointer,
        ctypes.c_size_t,
        number,
        number,
        pointer,
        _Estimate,
        pointer,
        pointer,
    ]

    def replay() -> tuple[FloatArray, FloatArray]:
        estimates, innovations = np.empty((len(samples), 4)), np.empty((len(samples), 2))
        function(
            samples.ctypes.data,
            len(samples),
            step,
            beta1,
            gains.ctypes.data,
            _Estimate(),
            estimates.ctypes.data,
            innovations.ctypes.data,
        )
        return estimates, innovations

    return replay
