"""The friction of the blind trials that flexid does not have, against its closed form."""

import numpy as np
import pytest
from benchmarks.trials.integrator import Drive, Law, Smooth, simulate


def played(drive, times, held):
    """States at the times, under a torque that is held from each time on."""
    course, nothing = np.zeros((len(times), 3)), np.zeros(len(times))
    rest = held.copy(), nothing, Smooth(np.empty(0), 0.0, 1.0), Law(), course, 0.0, 5e-5
    return simulate(drive, times, times, times, *rest)[0]


def test_lugre_creeps_before_it_breaks_away():
    """Assert that a load below the static friction stretches the bristles and does no more."""
    bristles = {"bristle_stiffness": 2000.0, "bristle_damping": 14.0, "stribeck_velocity": 0.05}
    bristles |= {"bristle_coulomb": 1.0, "bristle_static": 1.5}
    drive = Drive(0.01, 0.1, 10.0, link_viscous=1.0, **bristles)
    times = np.arange(3001) * 1e-3
    crept = played(drive, times, 0.8 * np.minimum(times, 1.0))[-1, 2]
    # Bristles that are pulled slowly: load = static (1 - exp(-stiffness x / static)).
    assert crept == pytest.approx(-np.log(1.0 - 0.8 / 1.5) * 1.5 / 2000.0, rel=0.02)
    assert played(drive, times, np.full(len(times), 1.6))[-1, 2] > 0.5
