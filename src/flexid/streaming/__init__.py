"""Estimation next to a drive: a stream is guarded, learnt from, judged, and can be saved."""
