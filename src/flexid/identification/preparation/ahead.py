"""Compile, beside a process that compiles the first functions, those that it needs next."""

import atexit
import subprocess
import sys
from contextlib import suppress

import numpy as np

from flexid.estimators.online import packed
from flexid.estimators.parametric_observer import parametric_observer, suggest_gains
from flexid.estimators.samples import Samples
from flexid.estimators.segmented_motion import motion_kernel, segments_kernel
from flexid.estimators.threads import cores
from flexid.identification.preparation.joint import flexible, rigid
from flexid.kernels.store import is_compiled

_COMPILE = "from flexid.identification.preparation import ahead; ahead.compile_what_comes_later()"


def compile_ahead() -> None:
    """Start a second process, unless this one has all it needs or there is no core for another."""
    if cores() < 2 or is_compiled(segments_kernel()):
        return
    nothing = subprocess.DEVNULL
    with suppress(OSError):  # what it would have compiled is then compiled here
        helper = subprocess.Popen(
            [sys.executable, "-c", _COMPILE], stdin=nothing, stdout=nothing, stderr=nothing
        )
        atexit.register(_end, helper)


def _end(helper: "subprocess.Popen[bytes]") -> None:
    helper.kill()
    helper.wait()


def compile_what_comes_later() -> None:
    """Compile what the identification of a usual joint needs after its first fits."""
    joint, stiff = flexible(), rigid()
    motion_kernel(joint.extended)
    motion_kernel(stiff.system)
    still = np.zeros((10, 2))
    record = Samples(still, still, np.zeros((10, 1)), 1e-3)
    gains = suggest_gains(record, joint.smooth)
    observer = parametric_observer(joint.smooth, gains, record.sample_time, "zero")
    observer.replay(observer.init(), packed(record))
