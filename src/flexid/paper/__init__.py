"""The paper's observer, and the closed loops in which it runs: derived, printed, compiled."""
