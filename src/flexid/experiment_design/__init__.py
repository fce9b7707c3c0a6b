"""What a motion can tell about a drive, and the input whose motion tells more."""
