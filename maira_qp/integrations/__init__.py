"""What speaks the language of other projects: LeRobot's kinematics, the messages of ROS. None of them is needed."""
