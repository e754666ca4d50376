"""Paths in the viewer: how one is made, followed, scrubbed, described and drawn."""
