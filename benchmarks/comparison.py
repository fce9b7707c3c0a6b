"""Comparison of flexid with a peer, and whether the goal is met."""

from dataclasses import dataclass

from benchmarks.timing import Timing


@dataclass(frozen=True)
class Side:
    """One of the two tools in a comparison.

    Parameters
    ----------
    name : str
        Tool, settings and limits of the comparison.
    timing : Timing
        Time of one job.
    """

    name: str
    timing: Timing


@dataclass(frozen=True)
class AtLeast:
    """Goal: flexid is at least this many times faster."""

    factor: float


@dataclass(frozen=True)
class AtMost:
    """Goal: flexid takes at most this many times the peer's time."""

    factor: float


@dataclass(frozen=True)
class Comparison:
    """Comparison of flexid with a peer on one job.

    Parameters
    ----------
    job : str
        Task of both.
    own, peer : Side
        Flexid and the peer.
    goal : AtLeast, AtMost or None
        None if the line is only for information.
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
        """Whether the goal is met; None without a goal."""
        match self.goal:
            case AtLeast(factor):
                return self.times_faster >= factor
            case AtMost(factor):
                return 1 / self.times_faster <= factor
        return None

    @property
    def description(self) -> str:
        """Job and both tools, as a sentence."""
        return f"{self.job}. flexid: {self.own.name}. Peer: {self.peer.name}."

    def cells(self) -> tuple[str, ...]:
        """Return the texts of the table's line, in the order of `HEADINGS`."""
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
    """Print median, minimum and number, such as ``6.42 ms (least 6.31, 15 runs)``."""
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
    """Table with details of the comparisons.

    Parameters
    ----------
    title : str
    headings : tuple of str
    lines : list of tuple of str
    remark : str, optional
        Note for the reader.
    """

    title: str
    headings: tuple[str, ...]
    lines: list[tuple[str, ...]]
    remark: str = ""


@dataclass(frozen=True)
class Outcome:
    """Results of one benchmark."""

    comparisons: list[Comparison]
    details: list[Detail]
