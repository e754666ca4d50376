"""Robots from MJCF, through the `mujoco` package."""
