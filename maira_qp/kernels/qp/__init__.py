"""Quadratic programs: with a box, with a box eight at a time, with rows and a box."""
