"""Online estimation from a stream: checks of samples, estimators, health, and sources."""
