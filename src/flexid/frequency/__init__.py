"""Small motions of what was found, by frequency."""
