"""Sizes of benchmarks: full for the pages, or very small for `benchmarks.smoke`."""

import os
from typing import TypeVar

SMOKE = "FLEXID_SMOKE"
"""Environment variable that makes every benchmark small."""

_Size = TypeVar("_Size")


def sized(full: _Size, smoke: _Size) -> _Size:
    """Return the full size, or the small one that only shows that the code runs."""
    return smoke if SMOKE in os.environ else full
