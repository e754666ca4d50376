"""Robots by name, from packages that carry their descriptions."""
