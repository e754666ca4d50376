"""Tables of poses with what a solver says of each, for learning."""
