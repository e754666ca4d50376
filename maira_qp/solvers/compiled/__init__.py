"""The compiled engine: a problem as arrays, and the kernels that answer it."""
