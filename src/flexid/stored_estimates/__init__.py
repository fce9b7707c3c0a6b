"""Stored estimates: reading them, validating them on other logs, and comparing them."""
