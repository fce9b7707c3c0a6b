"""Play of an arm's joints, of which least squares of a link's balance tells.

What moves a link is the torque of its spring, so that the rest of its balance shows how that
depends on the deflection: on a straight line, a cubic, or either beyond a dead zone.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from flexid.arms.fitting import EFFECT_BAND
from flexid.arrays import FloatArray
from flexid.estimators.balance_start import filtered
from flexid.estimators.samples import Samples
from flexid.identification.structure.gap import LIKELIER
from flexid.models.torque_balance import JointTerm, TorqueBalance

_GAPS = np.geomspace(0.02, 1.0, 25)  # halves of them, over the deflection's standard deviation
_CHANCE = 0.005  # of what is left, that is chance: a dozen of some 2400 independent rows


class _Spring(NamedTuple):
    """A spring that suits a torque, and the sum of squares that it leaves."""

    stiffness: float
    cubic: float
    left: float


def changes_by_play(
    balance: TorqueBalance, values: Mapping[str, float], recordings: tuple[Samples, ...]
) -> list[dict[str, float]]:
    """By how much each joint's spring changes if it has play; nothing where that is unlikely."""
    columns = filtered(balance, recordings, EFFECT_BAND).columns
    pi = np.array([values[name] for name in balance.coefficients])
    found = []
    for joint in range(1, balance.joints + 1):
        own = {
            f"{term.name}_{joint}": k
            for k, (_, number, term) in enumerate(balance.placed())
            if number == joint and isinstance(term, JointTerm) and term.place == "spring"
        }
        row = columns[:, 2 * joint - 2]
        torque = row @ np.where(np.isin(np.arange(len(pi)), [*own.values()]), 0.0, pi)
        names = f"joint_stiffness_{joint}", f"cubic_joint_stiffness_{joint}"
        deflection, cube = (-row[:, own.pop(name)] for name in names)
        rest = -row[:, [*own.values()]]
        curved = values[names[1]] != 0.0
        plain = _spring(torque, deflection, cube, rest, curved=curved)
        beyond = (deflection - np.clip(deflection, -gap, gap) for gap in _GAPS * np.std(deflection))
        tried = [
            _spring(torque, zone, zone**3, rest, curved=bent)
            for zone in beyond
            for bent in {False, curved}
        ]
        shares = zip(names, _change(plain, tried, curved=curved), strict=True)
        found.append({name: values[name] * share for name, share in shares if share})
    return found


def _change(plain: _Spring, tried: list[_Spring], *, curved: bool) -> tuple[float, float]:
    """Shares by which stiffness and hardening change, at most, with play that is likely.

    A spring that hardens may be one with play, if that leaves less at all. A straight one is not,
    unless it leaves much less: of play, hardening would have been found.
    """
    least = min(spring.left for spring in tried)
    wanted = 1.0 - _CHANCE if curved else LIKELIER
    if plain.stiffness <= 0.0 or least >= wanted * plain.left:
        return 0.0, 0.0
    likely = (spring for spring in tried if spring.left <= least / LIKELIER)
    own = max(likely, key=lambda spring: abs(spring.stiffness - plain.stiffness))
    hardens = own.cubic / plain.cubic - 1.0 if curved and plain.cubic else 0.0
    return own.stiffness / plain.stiffness - 1.0, hardens


def _spring(
    torque: FloatArray, deflection: FloatArray, cube: FloatArray, rest: FloatArray, *, curved: bool
) -> _Spring:
    columns = np.column_stack((deflection, rest, *([cube] if curved else [])))
    scale = np.maximum(np.abs(columns).max(axis=0), 1e-300)
    solved = np.linalg.lstsq(columns / scale, torque, rcond=None)[0] / scale
    left = torque - columns @ solved
    return _Spring(float(solved[0]), float(solved[-1]) if curved else 0.0, float(left @ left))
