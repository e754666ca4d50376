"""Inverse kinematics in closed form, and the geometry that it stands on."""
