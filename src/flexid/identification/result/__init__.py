"""What an identification returns."""
