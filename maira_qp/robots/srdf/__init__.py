"""What is said of a robot beside its kinematics: groups, named configurations, links that may touch."""
