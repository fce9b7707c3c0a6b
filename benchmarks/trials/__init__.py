"""Blind trials: random drives, motions and sensors, identified blindly and scored."""
