"""What of the full model a log shows."""
