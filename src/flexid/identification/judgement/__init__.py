"""Intervals, and what they deserve."""
