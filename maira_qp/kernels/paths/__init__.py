"""Paths: the best line through layers of configurations."""
