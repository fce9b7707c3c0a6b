"""Export of estimates and models: C99 for drives, FMUs, and scenes for MuJoCo."""
