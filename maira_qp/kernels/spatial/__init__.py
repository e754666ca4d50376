"""Rotations and poses: checks, the pose error by the quaternion logarithm, its derivatives."""
