"""Blind trials: random drives, motions and sensors, identified without the truth and scored."""
