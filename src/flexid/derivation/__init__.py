"""The only importer of SymPy: declarations become observers, closed loops and source."""
