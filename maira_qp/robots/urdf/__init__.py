"""Robots from URDF text, and back."""
