"""What the tests share: robots, problems and slow twins of the kernels."""
