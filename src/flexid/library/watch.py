"""Estimation next to a drive: `flexid.watch`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import inf
from typing import TYPE_CHECKING, Any, Literal

from flexid.errors import ArgumentError, RecordingError, SettingError
from flexid.library.answer import Answer
from flexid.library.arguments import as_samples, entrance, with_deviations
from flexid.streaming.health import Health, Judgement

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from flexid.arrays import FloatArray
    from flexid.estimators.excitation import Excitation
    from flexid.identification.vocabulary.evidence import CoefficientEstimate, ParameterEstimate
    from flexid.library.arguments import FilePath, Known, Terms
    from flexid.library.joint_estimate import JointEstimate
    from flexid.library.logs import Columns
    from flexid.models.motion import JointType
    from flexid.streaming.guard import Counts
    from flexid.streaming.learner import Departure
    from flexid.streaming.session import Change, Follower, Session


_AT_ONCE = 64  # samples that wait to be worked on, unless something is read


class Watch(Answer):
    """A stream that is watched: fed, or followed, and read at any time; `flexid.watch` makes it."""

    _report = "watch"
    _file = "watch.json"

    time: float
    """Time of the latest sample in s."""
    coefficients: Mapping[str, CoefficientEstimate]
    """Coefficients of the model by name, with intervals and verdicts."""
    parameters: Mapping[str, ParameterEstimate]
    """Physical parameters by name, with intervals and verdicts."""
    excitation: Mapping[str, Excitation]
    """Excitation of each row by what was learnt from: (A4) of Huang (2003), measured."""
    counts: Counts
    """What became of the samples."""
    changes: tuple[Change, ...]
    """When the drive changed, as far as its motion says."""
    departures: tuple[Departure, ...]
    """What differs from the estimate that the drive is held against, the clearest first."""

    def __init__(self, follower: Follower, every: float) -> None:
        self._follower, self._every = follower, every
        self._names: set[str] = set()  # of what is fed
        self._sampled: list[str] = []  # of what is learnt from of that, in a sample's order
        self._start = 0.0
        self._since_start = 0
        self._pending: list[FloatArray] = []
        self._n_pending = 0

    @property
    def result(self) -> Session:
        """The session, with all that was fed."""
        session = self._follower.session
        if session is None:
            raise ArgumentError("watch", "samples", "have not come yet: feed some first")
        self._catch_up(session)
        return session

    @property
    def has_begun(self) -> bool:
        """Whether samples have come."""
        return self._follower.session is not None

    @property
    def has_converged(self) -> bool:
        """Whether the intervals of spring and inertias are narrow."""
        return self.health.health is Health.CONVERGED

    def turns(self) -> Iterator[bool]:
        """Follow the source; whether a report is due, after each turn in which it was looked at."""
        if self._follower.source is None:
            raise ArgumentError("watch", "source", "is missing: give one, or feed samples")
        return self._follower.turns(self._every)

    def _catch_up(self, session: Session) -> None:
        """Work on what was fed one by one: a call for each sample would cost ten times as much."""
        if self._pending:
            import numpy as np

            samples = np.concatenate(self._pending)
            self._pending, self._n_pending = [], 0
            session.feed(samples)

    def feed(
        self,
        *,
        motor_position: ArrayLike,
        link_position: ArrayLike | None = None,
        deflection: ArrayLike | None = None,
        motor_torque: ArrayLike | None = None,
        motor_current: ArrayLike | None = None,
        motor_voltage: ArrayLike | None = None,
        time: ArrayLike | None = None,
    ) -> None:
        """Take in one sample, or a block of them; how a stream is cut into blocks changes nothing.

        Parameters
        ----------
        motor_position : float or array, shape (n,)
            In rad, at the link's side of the gear; in m where the joint is prismatic.
        link_position, deflection : float or array, shape (n,), optional
            One of them, in the same unit; without either the joint is taken as rigid.
        motor_torque, motor_current, motor_voltage : float or array, shape (n,)
            One of them, in N m or N, A or V; without any the link alone is watched, driven by the
            motor's measured motion.
        time : float or array, shape (n,), optional
            In s; without it every sample follows the one before after a sample time.
        """
        import numpy as np

        given = {
            "time": time,
            "link_position": link_position,
            "deflection": deflection,
            "motor_position": motor_position,
            "motor_torque": motor_torque,
            "motor_current": motor_current,
            "motor_voltage": motor_voltage,
        }
        arrays = {
            name: as_samples(name, values) for name, values in given.items() if values is not None
        }
        lengths = {name: len(values) for name, values in arrays.items()}
        if len({*lengths.values()}) > 1:
            raise ArgumentError("feed", "samples", f"differ in number: {lengths}")
        names = {*arrays} - {"time"}
        session = self._follower.session or self._begin(arrays)
        if names != self._names:
            given, before = (", ".join(sorted(each)) for each in (names, self._names))
            raise ArgumentError(
                "feed", "channels", f"are {given}, and were {before}: give the same"
            )
        count, h = lengths["motor_position"], session.options.sample_time
        if time is None:
            steps = self._since_start + np.arange(count, dtype=np.float64)
            arrays["time"] = self._start + h * steps
            self._since_start += count
        elif count:
            self._start, self._since_start = float(arrays["time"][-1]) + h, 0
        self._pending.append(np.column_stack([arrays[name] for name in self._sampled]))
        self._n_pending += count
        if self._n_pending >= _AT_ONCE:
            self._catch_up(session)

    def _begin(self, arrays: Mapping[str, FloatArray]) -> Session:
        from flexid.recording.channel import Channel, Origin, si_units
        from flexid.streaming.options import chosen_channels

        follower = self._follower
        if follower.source is not None:
            raise ArgumentError("feed", "samples", "come from the source: iterate over it instead")
        made = "revolute" if follower.estimate is None else follower.estimate.joint
        joint: JointType = follower.chosen["joint_type"] or made
        channels = {}
        for name, values in {"time": arrays["motor_position"][:0], **arrays}.items():
            origin = Origin({name: 1.0}, 1.0, 0.0, si_units(name, joint)[0], None)
            channels[name] = Channel(values, name, True, origin)
        chosen = chosen_channels("feed", channels, (), follower.kind)
        session = follower.begin(chosen, follower.chosen["sample_time"])
        self._names, self._sampled = {*arrays} - {"time"}, [*chosen.sampled]
        return session

    def __iter__(self) -> Iterator[Watch]:
        """Follow the source; a turn each `every` seconds of the stream, and one at its end."""
        error = None
        try:
            for due in self.turns():
                if due:
                    yield self
        except RecordingError as found:
            error = found
        if self.has_begun:
            yield self
        if error is not None:
            raise error

    @property
    def health(self) -> Judgement:
        """How the estimation is, a `Health`, and the reason, a sentence."""
        if not self.has_begun:
            return Judgement(Health.CONVERGING, "no sample has come so far")
        return self.result.health

    @property
    def warnings(self) -> tuple[str, ...]:
        """What was assumed of the source's columns, and what a stream does not account for."""
        return self._follower.warnings

    def __repr__(self) -> str:
        health = self.health
        return f"<Watch: {health.health.words}, {health.reason}>"


@entrance
def watch(
    source: str | FilePath | None = None,
    *,
    columns: Columns | None = None,
    header: str | None = None,
    sample_time: float | None = None,
    estimate: JointEstimate | FilePath | Mapping[str, Any] | None = None,
    known: Known | None = None,
    model: Literal["auto", "flexible", "link", "rigid"] = "auto",
    terms: Terms = "usual",
    hold: Literal["auto", "linear", "zero"] = "auto",
    filter_rate: float | None = None,
    memory: float = inf,
    coulomb_velocity: float | None = None,
    every: float = 1.0,
    stop_at_end: bool = False,
) -> Watch:
    """Estimate a drive's parameters while it runs.

    Samples are lines of numbers below a header, as in a log. Outliers, gaps, late and repeated
    samples, encoders that stick and inputs at their limit are left out and counted. Without an
    input the link alone is watched, driven by the motor's measured motion.

    Without a source, feed samples with `Watch.feed`; with one, iterate over the `Watch`.

    Parameters
    ----------
    source : str or path, optional
        A text file that may grow, - for standard input, or a log of another format such as MCAP.
    columns : path or mapping, optional
        A column map, as for logs; of samples that are fed, only its ``joint`` counts.
    header : str, optional
        Names of the columns, where the source does not begin with them.
    sample_time : float, optional
        Seconds between samples; without it, that of the source's first time stamps.
    estimate : JointEstimate, path or mapping, optional
        An estimate that the drive is compared with: the estimate.json of flexid identify. Or what
        `flexid.identify` returned. Its model, terms and filter are taken. Where the drive departs
        from its values, the health is inconsistent and says in what and by how much.
    known : mapping of str to float or pair of float, optional
        Physical parameters or coefficients that are known, with their standard deviation if they
        have one. As `flexid.identify` takes them.
    model : {"auto", "flexible", "link", "rigid"}, optional
        Model of the joint; that of the estimate, or what the channels show, if not given.
    terms : iterable of str, optional
        Terms of the model besides the joint spring; those of the estimate, or the usual ones:
        gravity, viscous and Coulomb friction of the motor, damping of the spring. A rigid joint
        has gravity, gravity_cosine, viscous, viscous_asymmetry, coulomb and offset. See
        `flexid.TERMS`.
    hold : {"auto", "linear", "zero"}, optional
        The input between samples, on straight lines or held; that of the estimate if not given, or
        the intervals are wider by what it matters.
    filter_rate : float, optional
        Rate of the filter of least squares in 1/s; that of the estimate, or 20, if not given.
    memory : float, optional
        Seconds after which a sample counts 1/e as much.
    coulomb_velocity : float, optional
        Velocity over which Coulomb friction changes its sign; that of the estimate, or 0.1 rad/s
        or 0.005 m/s, if not given.
    every : float, optional
        Seconds of the stream between two reports.
    stop_at_end : bool, optional
        Stop at the end of a file, rather than wait for it to grow.

    Examples
    --------
    >>> watch = flexid.watch(sample_time=1e-3)  # doctest: +SKIP
    >>> watch.feed(link_position=0.1, motor_position=0.11, motor_torque=2.0)  # doctest: +SKIP
    >>> watch.health.reason  # doctest: +SKIP
    """
    from flexid.library.identify import estimated
    from flexid.library.logs import as_columns
    from flexid.recording.recipes import read_map
    from flexid.streaming.options import check_comparable
    from flexid.streaming.session import Follower

    if source is None and sample_time is None:
        raise ArgumentError("watch", "sample_time", "is missing: give it in s, or a source")
    values, deviations = with_deviations(known)
    chosen = {
        "terms": None if terms == "usual" else terms,
        "hold": hold,
        "kind": model,
        "known": values,
        "known_deviations": deviations,
        "memory": memory,
        "filter_rate": filter_rate,
        "coulomb_velocity": coulomb_velocity,
        "sample_time": sample_time,
        "joint_type": None,
    }
    made = None if estimate is None else estimated(estimate).of_joint
    if made is not None:
        check_comparable(made)
    column_map = as_columns(columns)
    if source is None and column_map is not None:
        chosen["joint_type"] = read_map(column_map).joint
    follower = Follower(
        None if source is None else str(source),
        chosen,
        estimate=made,
        column_map=column_map,
        header=header,
        stop_at_end=stop_at_end,
    )
    if not every > 0.0:
        raise SettingError("every", f"must be above 0 s, got {every}")
    return Watch(follower, every)
