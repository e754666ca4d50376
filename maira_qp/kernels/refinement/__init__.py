"""What follows the search: the optimum in the null space of a pose, and the closest reachable pose."""
