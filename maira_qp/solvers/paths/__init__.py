"""Paths: which way along the redundancy and the branches a sequence of poses is followed without a jump."""
