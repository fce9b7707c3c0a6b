"""Options of a command that runs on logs of the blind trials."""

import argparse
from collections.abc import Collection


def add_log_options(parser: argparse.ArgumentParser, seeds: int, families: Collection[str]) -> None:
    """Say which logs: ``--seeds``, ``--first-seed`` and ``--family``.

    Parameters
    ----------
    parser : ArgumentParser
        It gets the options.
    seeds : int
        Logs of each family, if not said otherwise.
    families : collection of str
        Those to choose from.
    """
    parser.add_argument("--seeds", type=int, default=seeds, help="logs of each family")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--family", action="append", choices=families, help="may be repeated")


def logs_of(options: argparse.Namespace, families: Collection[str]) -> list[tuple[str, int]]:
    """Family and seed of every log; all families early, so that what is broken off shows each."""
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    return [(name, seed) for seed in seeds for name in options.family or families]
