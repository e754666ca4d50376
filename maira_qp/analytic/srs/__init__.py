"""Arms with a spherical shoulder, an elbow and a spherical wrist: the self-motion by its swivel angle."""
