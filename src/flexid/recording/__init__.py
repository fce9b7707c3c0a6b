"""Recordings of logs: reading, units, checks and velocities."""

from flexid.recording.read import read_log
from flexid.recording.recording import Log, Recording
from flexid.recording.velocities import position_noise, with_velocities

__all__ = ["Log", "Recording", "position_noise", "read_log", "with_velocities"]
