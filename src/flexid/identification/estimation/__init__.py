"""The structure fitted to all data, and all that is doubted."""
