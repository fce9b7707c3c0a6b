"""A deflection of the wrong sign: what the log would be with it turned round."""

from collections.abc import Sequence
from dataclasses import replace

from flexid.estimators.rowwise import LeastSquaresFit
from flexid.identification.full_model.model import Structure, data_of
from flexid.identification.full_model.starting import least_squares_start
from flexid.recording.recording import Recording

_FILTER_RATE = 20.0  # 1/s


def turned_round(
    structure: Structure, recordings: Sequence[Recording], groups: Sequence[int], share: float
) -> bool:
    """Whether a measured deflection explains the link's motion if its sign is changed, only then.

    The link's row alone decides: the motor's fits either way, with a stiffness of either sign.
    """
    if not recordings[0].link_from_deflection:
        return False
    fits = [
        least_squares_start(structure, data_of(structure.joint, some, groups), _FILTER_RATE)[1]
        for some in (recordings, [mirrored(recording) for recording in recordings])
    ]
    as_it_is, other = (_unexplained(fit) for fit in fits)
    springs = dict(zip(fits[1].names, fits[1].values.tolist(), strict=True))
    positive = all(springs.get(name, 1.0) > 0.0 for name in ("theta2", "alpha1"))
    return positive and other < share * as_it_is


def mirrored(recording: Recording) -> Recording:
    """The recording with its deflection turned round."""
    motor, link = recording.motor_position, recording.needed_link_position
    found = replace(recording, link_position=2.0 * motor - link)
    if recording.link_velocity is None or recording.motor_velocity is None:
        return found
    return replace(found, link_velocity=2.0 * recording.motor_velocity - recording.link_velocity)


def _unexplained(fit: LeastSquaresFit) -> float:
    """Share of the link's squared acceleration that no term explains."""
    (link,) = (row for row in fit.rows if row.name == "link")
    return link.residual_sum / link.total_sum if link.total_sum else 0.0
