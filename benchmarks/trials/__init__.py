"""Blind trials: random drives, motions and sensors, identified untold and scored."""
