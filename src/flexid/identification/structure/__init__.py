"""Choice of the structure: the terms of the full model that a log shows."""
