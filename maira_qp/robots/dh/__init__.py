"""Robots from tables of Denavit-Hartenberg parameters."""
