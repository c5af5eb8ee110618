"""Scenes with a clock and an oracle."""
