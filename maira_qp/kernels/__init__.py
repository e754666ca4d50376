"""The compiled layer (Numba): arrays in, arrays out; no classes, no Pinocchio; one concept a file.

Nothing here checks its arguments or raises. Every kernel has a slow, obvious twin in the tests.
"""
