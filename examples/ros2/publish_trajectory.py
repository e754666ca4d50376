"""Publish a trajectory that `mq.save(trajectory, "path.ros.json")` wrote, once, to a controller of ROS 2.

python publish_trajectory.py path.ros.json /joint_trajectory_controller/joint_trajectory
"""

import json
import sys
import time
from pathlib import Path

import rclpy
from rosidl_runtime_py import set_message_fields
from trajectory_msgs.msg import JointTrajectory

PATIENCE = 5.0
"""How long a controller is waited for [s]."""


def main(file: str, topic: str) -> int:
    """Publishes the trajectory when somebody listens; 0, or 1 if nobody does."""
    message = JointTrajectory()
    set_message_fields(message, json.loads(Path(file).read_text()))
    rclpy.init()
    node = rclpy.create_node("maira_qp_trajectory")
    publisher = node.create_publisher(JointTrajectory, topic, 1)
    end = time.monotonic() + PATIENCE
    while publisher.get_subscription_count() == 0 and time.monotonic() < end:
        rclpy.spin_once(node, timeout_sec=0.1)
    listeners = publisher.get_subscription_count()
    if listeners:
        publisher.publish(message)  # the stamp is zero: it begins at once
        publisher.wait_for_all_acked()
    node.get_logger().info(f"{len(message.points)} points on {topic}, {listeners} listening")
    node.destroy_node()
    rclpy.shutdown()
    return 0 if listeners else 1


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:3]))
