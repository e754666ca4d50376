"""What the viewer draws: robot, tool, surroundings."""
