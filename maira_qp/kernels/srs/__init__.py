"""Closed form of S-R-S arms: the swivel angle, its feasible intervals, the certificate of unreachability."""
