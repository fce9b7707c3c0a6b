"""The full model, fitted to data."""
