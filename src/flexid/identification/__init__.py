"""Identification of a joint: from logs and a model to an estimate."""
