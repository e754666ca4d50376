"""The quadratic programs that a problem makes, and who solves them."""
