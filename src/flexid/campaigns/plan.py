"""Which values every run of a campaign has: decided by the file alone, before anything runs."""

import hashlib
from dataclasses import dataclass

import numpy as np
import polars as pl
from numpy.typing import NDArray

from flexid.experiments.variation import Distribution, Variation

SEED = "sampling.seed"
"""Path of the seed of a run's noise; drawn for every run unless it is varied explicitly."""

_SMALLEST_SHARE = 2.0**-53


@dataclass(frozen=True)
class Plan:
    """The values of every run."""

    inputs: tuple[str, ...]  # dotted paths of what varies
    values: NDArray[np.float64]  # (n_runs, n_inputs), in SI units
    # from which each run's noise has its seed, where the loop is sampled and its seed not among
    # the inputs
    seed: int | None

    def table(self, runs: range) -> pl.DataFrame:
        """Number and values of some consecutive runs, one row each."""
        values = self.values[runs.start : runs.stop]
        columns = {"run": np.arange(runs.start, runs.stop, dtype=np.int64)}
        columns |= dict(zip(self.inputs, values.T, strict=True))
        if self.seed is not None:
            columns[SEED] = np.array([_run_seed(self.seed, run) for run in runs], dtype=np.int64)
        return pl.DataFrame(columns)

    @property
    def digest(self) -> str:
        """Hash of all values: equal plans have equal digests."""
        content = hashlib.sha256("\n".join((*self.inputs, str(self.seed))).encode())
        content.update(np.ascontiguousarray(self.values).tobytes())
        return content.hexdigest()[:16]


def make_plan(variation: Variation, sampled: bool) -> Plan:
    """Plan the runs of a campaign; the same variation always gives the same plan."""
    inputs = tuple(variation.vary)
    values = _grid(variation) if variation.kind == "grid" else _draws(variation)
    return Plan(inputs, values, variation.seed if sampled and SEED not in inputs else None)


def _grid(variation: Variation) -> NDArray[np.float64]:
    """Every combination; the last input changes fastest."""
    axes = [np.array(values, dtype=float) for values in variation.vary.values()]
    mesh = np.meshgrid(*axes, indexing="ij")
    return np.stack([one.ravel() for one in mesh], axis=1)


def _draws(variation: Variation) -> NDArray[np.float64]:
    from scipy.stats import qmc  # late: it loads for a second, and no worker needs it

    runs, count = variation.runs, len(variation.vary)
    if variation.kind == "latin-hypercube":
        shares = qmc.LatinHypercube(count, rng=variation.seed).random(runs)
    else:  # the first points of the scrambled sequence
        points = qmc.Sobol(count, rng=variation.seed).random_base2(int(np.ceil(np.log2(runs))))
        shares = points[:runs]
    # 0 is a possible draw, and the normal distribution's lowest value is minus infinity
    shares = np.maximum(shares, _SMALLEST_SHARE)
    columns = [
        _quantile(what, shares[:, place]) for place, what in enumerate(variation.vary.values())
    ]
    return np.stack(columns, axis=1)


def _quantile(
    what: tuple[float, ...] | Distribution, shares: NDArray[np.float64]
) -> NDArray[np.float64]:
    if isinstance(what, Distribution):
        return what.quantile(shares)
    values = np.array(what, dtype=float)
    return values[np.floor(shares * len(values)).astype(int)]


def _run_seed(seed: int, run: int) -> int:
    """Seed of a run's noise, from the campaign's seed and the run's number alone."""
    child = np.random.SeedSequence(seed, spawn_key=(run,))
    return int(child.generate_state(1, np.uint64)[0] >> 1)
