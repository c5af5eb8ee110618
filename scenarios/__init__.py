"""Scenes with a driver and a check."""
