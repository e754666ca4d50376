"""Maps of what an arm can reach: a grid of positions times a grid of orientations."""
