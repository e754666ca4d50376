"""All solutions of a pose, and the nearest of them."""
