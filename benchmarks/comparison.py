"""One line of the result: flexid beside a peer, and whether the goal is met."""

from dataclasses import dataclass

from benchmarks.timing import Timing


@dataclass(frozen=True)
class Side:
    """One of the two in a comparison.

    Parameters
    ----------
    name : str
        Tool, settings and whatever limits the comparison.
    timing : Timing
        Of one job.
    """

    name: str
    timing: Timing


@dataclass(frozen=True)
class AtLeast:
    """Goal: flexid is this many times faster."""

    factor: float


@dataclass(frozen=True)
class AtMost:
    """Goal: flexid takes no more than this many times the peer's time."""

    factor: float


@dataclass(frozen=True)
class Comparison:
    """Flexid beside a peer on one job.

    Parameters
    ----------
    job : str
        What both do.
    own, peer : Side
        Flexid and the other one.
    goal : AtLeast, AtMost or None
        None where the line is for information.
    """

    job: str
    own: Side
    peer: Side
    goal: AtLeast | AtMost | None = None

    @property
    def times_faster(self) -> float:
        """Peer's median time over flexid's."""
        return self.peer.timing.median / self.own.timing.median

    @property
    def met(self) -> bool | None:
        """Whether the goal is met, where there is one."""
        match self.goal:
            case AtLeast(factor):
                return self.times_faster >= factor
            case AtMost(factor):
                return 1 / self.times_faster <= factor
        return None

    @property
    def description(self) -> str:
        """What was done, and by what."""
        return f"{self.job}. flexid: {self.own.name}. Peer: {self.peer.name}."

    def cells(self) -> tuple[str, ...]:
        """Texts of a table's line, in the order of `HEADINGS`."""
        if isinstance(self.goal, AtMost) or self.times_faster < 1:
            ratio = f"{1 / self.times_faster:.2f} × time"
        else:
            digits = 1 if self.times_faster < 10 else 0
            ratio = f"{self.times_faster:.{digits}f} × faster"
        goal = {AtLeast: "≥ {:.4g}", AtMost: "≤ {:.4g}", type(None): "–"}
        return (
            duration(self.own.timing),
            duration(self.peer.timing),
            ratio,
            goal[type(self.goal)].format(getattr(self.goal, "factor", 0)),
            {True: "yes", False: "NO", None: "–"}[self.met],
        )


HEADINGS = ("flexid", "peer", "ratio", "goal", "met")


def duration(timing: Timing) -> str:
    """Median, least and number, e.g. ``6.42 ms (least 6.31, 15 runs)``."""
    unit, factor = next(
        (unit, factor)
        for unit, factor in (("s", 1.0), ("ms", 1e3), ("µs", 1e6), ("ns", 1e9))
        if timing.median * factor >= 1.0 or unit == "ns"
    )
    if timing.repetitions == 1:
        return f"{timing.median * factor:.3g} {unit} (one run)"
    return (
        f"{timing.median * factor:.3g} {unit} "
        f"(least {timing.minimum * factor:.3g}, {timing.repetitions} runs)"
    )


@dataclass(frozen=True)
class Detail:
    """A table that stands behind the comparisons.

    Parameters
    ----------
    title : str
    headings : tuple of str
    lines : list of tuple of str
    remark : str, optional
        What a reader has to know of it.
    """

    title: str
    headings: tuple[str, ...]
    lines: list[tuple[str, ...]]
    remark: str = ""


@dataclass(frozen=True)
class Outcome:
    """What one benchmark found."""

    comparisons: list[Comparison]
    details: list[Detail]
