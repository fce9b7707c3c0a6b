"""Figures and tables, made from result objects only."""
