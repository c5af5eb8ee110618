"""The manual: its pages, its recipes, and what builds it (README.md)."""
