"""Fits made up by hand, of which no more is known than what a choice among fits asks for."""

from types import SimpleNamespace
from typing import Any

from flexid.estimators.channel_timing import Timing
from flexid.identification.full_model.model import Structure
from flexid.identification.preparation.joint import flexible

JOINT = flexible()
WITHOUT = Structure(JOINT, frozenset(JOINT.optional), Timing("cubic"))
"""A joint with no optional term."""


def made_fit(
    excess: float = 1.0, *, cost: float = 0.0, segments: Any = range(4), states: Any = None, **more
) -> Any:
    """A fit that leaves so much, of a joint with no optional term but for what is given."""
    minimum = SimpleNamespace(
        equations=SimpleNamespace(cost=cost), point=SimpleNamespace(initial_states=states)
    )
    usual = {"duration": 1.0, "structure": WITHOUT, "by_name": {}, "data": None}
    problem = SimpleNamespace(segments=segments)
    return SimpleNamespace(excess=excess, minimum=minimum, problem=problem, **{**usual, **more})


def over(segments: int, excess: float, structure: Structure = WITHOUT) -> Any:
    """A fit over segments of 2 s divided by their number."""
    return made_fit(excess, segments=range(segments), duration=2.0 / segments, structure=structure)
