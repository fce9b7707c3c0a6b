"""Excitation of a drive by a log, and design of better inputs."""
