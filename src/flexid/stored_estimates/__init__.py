"""Estimates as files: read, rebuilt, held against other logs."""
