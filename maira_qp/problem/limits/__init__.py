"""Hard limits: of joints, of their acceleration, linear, and of distances between bodies."""
