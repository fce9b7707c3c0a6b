"""Two estimates side by side."""
