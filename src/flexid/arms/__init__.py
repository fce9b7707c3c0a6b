"""Identification of arms with several elastic joints."""
