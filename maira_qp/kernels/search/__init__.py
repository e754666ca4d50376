"""Multi-start Levenberg-Marquardt: the descent, its seeds, the search over attempts."""
