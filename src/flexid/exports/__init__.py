"""An estimate or a model as code and files for other tools: C99 for a drive, and more."""
