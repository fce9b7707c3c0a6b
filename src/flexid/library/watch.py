"""Online estimation while a drive runs: `flexid.watch`."""

from __future__ import annotations

from collections.abc import Mapping
from math import inf
from typing import TYPE_CHECKING, Any, Literal

from flexid.errors import ArgumentError, SettingError
from flexid.library.arguments import entrance, with_deviations

if TYPE_CHECKING:
    from flexid.library.arguments import AutoModel, FilePath, Known, Terms
    from flexid.library.joint_estimate import JointEstimate
    from flexid.library.logs import Columns
    from flexid.library.watched import Watch


@entrance
def watch(
    source: str | FilePath | None = None,
    *,
    columns: Columns | None = None,
    header: str | None = None,
    sample_time: float | None = None,
    estimate: JointEstimate | FilePath | Mapping[str, Any] | None = None,
    known: Known | None = None,
    model: AutoModel = "auto",
    terms: Terms = "usual",
    hold: Literal["auto", "linear", "zero"] = "auto",
    filter_rate: float | None = None,
    memory: float = inf,
    coulomb_velocity: float | None = None,
    every: float = 1.0,
    stop_at_end: bool = False,
) -> Watch:
    """Estimate a drive's parameters while it runs.

    Samples are lines of numbers below a header, as in a log. Outliers, late and repeated samples,
    stuck encoders, saturated inputs and gaps are excluded and counted. Without an input the link
    alone is estimated, driven by the motor's measured motion.

    Without a source, feed samples with `Watch.feed`; with one, iterate over the `Watch`.

    Parameters
    ----------
    source : str or path, optional
        A text file that may still grow, - for standard input, or a log in another format.
    columns : path or mapping, optional
        A column map, as for logs. With samples from `Watch.feed`, only its ``joint`` is used.
    header : str, optional
        Names of the columns, if the source does not begin with a header. For example
        'time [s],link_position [deg],motor_position [deg],motor_torque [N m]'.
    sample_time : float, optional
        Seconds between samples; by default from the source's first time stamps.
    estimate : JointEstimate, path or mapping, optional
        An estimate to compare the drive with: an estimate.json of flexid identify. Or a result of
        `flexid.identify`. Its model, terms and filter are used. If the drive departs from its
        values, the health becomes inconsistent, and the report names the values and their change.
    known : mapping of str to float or pair of float, optional
        Known values of physical parameters or coefficients, each exact or with a standard
        deviation. As `flexid.identify` takes them.
    model : {"auto", "flexible", "link", "rigid"}, optional
        Model of the joint; by default as in the estimate, else according to the channels.
    terms : iterable of str, optional
        Terms of the model besides the joint spring; by default as in the estimate, else gravity,
        viscous and Coulomb friction of the motor, and damping of the spring. A rigid joint
        has gravity, gravity_cosine, viscous, viscous_asymmetry, coulomb and offset. See
        `flexid.TERMS`.
    hold : {"auto", "linear", "zero"}, optional
        The input between samples: on straight lines (linear) or held (zero). By default as in the
        estimate; else unknown, and the intervals are widened by its effect.
    filter_rate : float, optional
        Rate in 1/s of the least-squares filter; by default as in the estimate, else 20.
    memory : float, optional
        Seconds after which a sample counts 1/e as much.
    coulomb_velocity : float, optional
        Velocity over which Coulomb friction changes sign; by default as in the estimate, else
        0.1 rad/s or 0.005 m/s.
    every : float, optional
        Seconds of the stream between reports.
    stop_at_end : bool, optional
        Stop at the end of a file instead of waiting for more samples.

    Examples
    --------
    >>> watch = flexid.watch(sample_time=1e-3)  # doctest: +SKIP
    >>> watch.feed(link_position=0.1, motor_position=0.11, motor_torque=2.0)  # doctest: +SKIP
    >>> watch.health.reason  # doctest: +SKIP
    """
    from flexid.library.identify import estimated
    from flexid.library.logs import as_columns
    from flexid.library.watched import Watch
    from flexid.recording.recipes import read_map
    from flexid.streaming.options import check_comparable

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
    if not every > 0.0:
        raise SettingError("every", f"must be above 0 s, got {every}")
    return Watch(
        None if source is None else str(source),
        chosen,
        every,
        estimate=made,
        column_map=column_map,
        header=header,
        stop_at_end=stop_at_end,
    )
