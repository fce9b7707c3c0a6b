"""Fits to all data, with or without disturbances, and the doubts that widen their intervals."""
