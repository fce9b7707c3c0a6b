"""Estimates as files: read, and compared with other logs."""
