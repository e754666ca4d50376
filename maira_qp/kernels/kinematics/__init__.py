"""Forward kinematics and Jacobians of chains and trees; whole turns."""
