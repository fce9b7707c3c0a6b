"""Command line: commands generated from the public functions, and the output of results."""
