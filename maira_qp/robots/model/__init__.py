"""The kinematic model: joints, limits, forward kinematics, configurations."""
