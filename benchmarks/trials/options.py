"""Options of commands that run on logs of the blind trials."""

import argparse
from collections.abc import Collection


def add_log_options(parser: argparse.ArgumentParser, seeds: int, families: Collection[str]) -> None:
    """Add the options that choose logs: ``--seeds``, ``--first-seed`` and ``--family``.

    Parameters
    ----------
    parser : ArgumentParser
        Parser that gets the options.
    seeds : int
        Default number of logs of each family.
    families : collection of str
        Families to choose from.
    """
    parser.add_argument("--seeds", type=int, default=seeds, help="logs of each family")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--family", action="append", choices=families, help="may be repeated")


def logs_of(options: argparse.Namespace, families: Collection[str]) -> list[tuple[str, int]]:
    """Yield family and seed of every log, seed by seed, so that partial runs have all families."""
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    return [(name, seed) for seed in seeds for name in options.family or families]
