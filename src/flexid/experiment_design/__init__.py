"""What a motion determines of a drive, and the input whose motion determines more."""
