"""Recordings: reading, units, checks, velocities."""

from flexid.recording.read import read_log
from flexid.recording.recording import FloatArray, Log, Recording

__all__ = ["FloatArray", "Log", "Recording", "read_log"]
