"""Identification and loading: `flexid.identify`, `flexid.load`; estimates from any source."""

from __future__ import annotations

import hashlib
import logging
import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexid.errors import ArgumentError, SettingError
from flexid.identification.vocabulary import Progress, silent
from flexid.library.answer import EstimateAnswer
from flexid.library.arguments import entrance, joint_settings, one_thread

if TYPE_CHECKING:
    from flexid.arms.result import ArmIdentification
    from flexid.identification.preparation.settings import Settings
    from flexid.identification.vocabulary.thresholds import Thresholds
    from flexid.library.arguments import (
        AutoHold,
        AutoModel,
        AutoNumber,
        Bounds,
        FilePath,
        Known,
        Terms,
    )
    from flexid.library.joint_estimate import JointEstimate
    from flexid.library.logs import Columns, Logs
    from flexid.stored_estimates.estimate_file import StoredEstimate

_MANY = 300_000  # samples, whose identification takes about a minute
_LOG = logging.getLogger(__name__)


@entrance
@one_thread()
def identify(
    logs: Logs,
    *,
    columns: Columns | None = None,
    known: Known | None = None,
    bounds: Bounds | None = None,
    model: AutoModel = "auto",
    terms: Terms = "auto",
    hold: AutoHold = "auto",
    input_delay: AutoNumber = "auto",
    link_delay: AutoNumber = "auto",
    coulomb_velocity: AutoNumber = "auto",
    filter_rate: AutoNumber = "auto",
    segment_duration: AutoNumber = "auto",
    validation_share: float = 1 / 3,
    stream: bool = False,
    thresholds: Thresholds | None = None,
    progress: Progress = silent,
) -> JointEstimate:
    """Find a drive's parameters, with intervals and verdicts.

    The logs are of one drive with an elastic joint: two encoders and the motor's torque, voltage or
    current. With one encoder the joint is modelled as rigid. Without an input the link alone is
    identified, driven by the motor's motion. Settings that are auto are chosen from the logs.

    Parameters
    ----------
    logs : log or list of logs
        Logs of one drive. Paths of files, data frames of pandas, Polars, PyArrow or another library
        that `narwhals` knows, mappings of arrays, or logs of `flexid.read_log`. Columns are found
        by name, with their unit in brackets: ``"time [s]"``, ``"link_position [deg]"``,
        ``"motor_position [deg]"``, ``"motor_torque [N m]"``; of a prismatic joint in m and N.
    columns : path or mapping, optional
        A column map, which renames, scales and combines raw columns: a TOML file. Or its content as
        a mapping, ``{"motor_position": {"column": "pot_V", "scale": 35.32, "unit": "deg"}}``.
    known : mapping of str to float or (float, float), optional
        Known values of physical parameters or coefficients, each exact or with a standard
        deviation. For example ``{"motor_inertia": (0.3, 0.01)}``.
    bounds : mapping of str to (float, float), optional
        Lower and upper bound of physical parameters or coefficients. None means no bound:
        ``{"joint_stiffness": (50, None)}``.
    model : {"auto", "flexible", "link", "rigid"}, optional
        Model of the joint: flexible; link, for the link alone, driven by the measured motor
        position, without the input; or rigid, for a log of the motor's encoder alone.
    terms : iterable of str, optional
        Terms of the model besides the joint spring. A rigid joint has gravity, gravity_cosine,
        viscous, viscous_asymmetry, coulomb and offset. See `flexid.TERMS` and `flexid.SHAPE_TERMS`.
    hold : {"auto", "zero", "linear", "cubic"}, optional
        The input between samples: held (zero), on straight lines (linear) or smooth (cubic).
    input_delay : float, optional
        Seconds by which the input acts later than recorded.
    link_delay : float, optional
        Seconds by which the link's encoder lags behind the motor's.
    coulomb_velocity : float, optional
        Velocity in rad/s or m/s over which Coulomb friction changes sign; auto: abruptly.
    filter_rate : float, optional
        Rate in 1/s of the filter of the least-squares estimator.
    segment_duration : float, optional
        Length in seconds of the segments over which the model is fitted.
    validation_share : float, optional
        Share of each log, at its end, that is kept out of the fit and predicted.
    stream : bool, optional
        Read one Parquet file of any length in one pass and in bounded memory; fit by least squares,
        with the model chosen from the beginning of the file.
    thresholds : Thresholds, optional
        Thresholds of all decisions; by default `flexid.Thresholds()`.
    progress : callable, optional
        Called with a description of each step, for example ``print``.

    Examples
    --------
    >>> estimate = flexid.identify("examples/flexible_joint.csv")  # doctest: +SKIP
    >>> estimate.parameters["joint_stiffness"].interval  # doctest: +SKIP
    """
    from flexid.identification.identify import identify as run
    from flexid.identification.vocabulary.thresholds import THRESHOLDS
    from flexid.library.joint_estimate import JointEstimate
    from flexid.library.logs import all_logs

    settings = joint_settings(
        known=known,
        bounds=bounds,
        model=model,
        terms=terms,
        hold=hold,
        input_delay=input_delay,
        link_delay=link_delay,
        coulomb_velocity=coulomb_velocity,
        filter_rate=filter_rate,
        segment_duration=segment_duration,
        validation_share=validation_share,
    )
    if stream:
        if thresholds is not None:
            raise SettingError("thresholds", "are not for a stream: leave them out")
        return JointEstimate(_streamed(logs, columns, settings, progress))
    read = all_logs(logs, columns)
    count = sum(len(recording) for log in read for recording in log.recordings)
    if count > _MANY:
        _LOG.info(
            "%d samples take minutes: a Parquet file is identified in one pass with --stream", count
        )
    return JointEstimate(run(read, settings, progress, thresholds or THRESHOLDS))


def _streamed(logs: Any, columns: Any, settings: Settings, progress: Progress) -> Any:
    from flexid.library.logs import as_columns
    from flexid.streaming.whole_log import identify_stream

    if len(logs) > 1:
        raise SettingError("stream", "only one log can be streamed: name one Parquet file")
    if not isinstance(logs[0], str | os.PathLike):
        raise ArgumentError("identify", "logs", "must be the path of one Parquet file to stream")
    return identify_stream(Path(logs[0]), as_columns(columns), settings, progress)


@entrance
def load(path: FilePath) -> JointEstimate:
    """Read an estimate saved by `JointEstimate.save` or by ``flexid identify --out``.

    It can predict and validate other logs. The time series of its own log are not stored.

    Parameters
    ----------
    path : path
        An ``estimate.json``.
    """
    from flexid.library.joint_estimate import JointEstimate
    from flexid.stored_estimates.estimate_file import read_estimate

    return JointEstimate(read_estimate(Path(path)).of_joint)


def estimated(estimate: JointEstimate | FilePath | Mapping[str, Any]) -> StoredEstimate:
    """Return the estimate of a result, of a file, or of the content of a file."""
    from flexid.arrays import to_json
    from flexid.library.joint_estimate import JointEstimate
    from flexid.stored_estimates.estimate_file import StoredEstimate, read_estimate

    if not isinstance(estimate, JointEstimate):
        return read_estimate(os.fspath(estimate) if isinstance(estimate, os.PathLike) else estimate)
    text = to_json(estimate._document())
    return StoredEstimate(estimate.result, "", hashlib.sha256(text.encode()).hexdigest())


class ArmEstimate(EstimateAnswer):
    """Estimate of an arm: parameters of each joint, with intervals and verdicts."""

    _report = "arm"

    result: ArmIdentification


@one_thread()
def identify_arm(
    log: Path, arm: Path, columns: Path | None = None, progress: Progress = silent
) -> ArmEstimate:
    """Identify the arm that a TOML file describes, from one log."""
    from flexid.arms.identify import identify_arm as run
    from flexid.models.model_file import read_arm

    return ArmEstimate(run(log, read_arm(arm), columns, progress))
