"""What the robot is: its DH table, its URDF, and the Pinocchio model with tip and limits."""
