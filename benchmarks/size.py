"""How large the benchmarks are: as the pages say, or for `benchmarks.smoke` as small as can be."""

import os
from typing import TypeVar

SMOKE = "FLEXID_SMOKE"
"""Variable of the environment that makes every benchmark small."""

_Size = TypeVar("_Size")


def sized(full: _Size, smoke: _Size) -> _Size:
    """The size to use: of the pages, or the one that shows no more than that the code runs."""
    return smoke if SMOKE in os.environ else full
