"""Logs too long for memory."""
