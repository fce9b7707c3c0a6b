"""Preparation of logs, settings and prior knowledge for the fit."""
