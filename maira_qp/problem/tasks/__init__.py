"""What is to be reached or kept: rows of an error, each with its Jacobian, weights, gain and priority."""
