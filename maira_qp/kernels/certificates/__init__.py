"""Branch-and-bound certificates of unreachability for any chain."""
