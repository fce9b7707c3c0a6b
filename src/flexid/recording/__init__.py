"""Recordings: reading, units, checks, velocities."""
