"""ROS joint_states in alphabetical order, joints by name, placing the other arm, locking a joint.

`pip install example-robot-data` for Baxter's description.
"""

from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

import numpy as np
from rich import print

import maira_qp as mq

try:
    folder = distribution("example-robot-data").locate_file("cmeel.prefix/share/example-robot-data/robots")
except PackageNotFoundError:
    raise SystemExit("this example needs Baxter's description: pip install example-robot-data") from None
robot = mq.Robot.from_urdf(Path(str(folder)) / "baxter_description/urdf/baxter.urdf", tip="left_gripper")
solver = mq.Solver(robot)

names = ["head_pan", *(f"{side}_{j}" for side in ("left", "right") for j in ("e0", "e1", "s0", "s1", "w0", "w1", "w2"))]
position = np.linspace(-0.4, 0.4, len(names))  # a JointState: sorted by name, with joints of the other arm and the head
q = position[robot.order(names)]  # in the robot's order; a joint that is missing is an error, others are skipped
state = dict(zip(names, position.tolist(), strict=True))
print(f"robot.order: {robot.joints(q)}")

target = robot.forward(
    {"left_s0": 0.2, "left_s1": -0.3, "left_e0": 0, "left_e1": 1, "left_w0": 0, "left_w1": 0.5, "left_w2": 0}
)
s = solver.solve(target, {"left_e1": 1.2})  # joints that are not named start in the middle of their limits
print(f"solve from a bent elbow: {s.status.name}, s.joints = {s.joints}")
elbow = mq.Solver(robot, redundancy=mq.Strict(mq.Posture({"left_e1": 0.8})))  # a wish for one joint
print(f"with a wish for left_e1: {elbow.solve(target).joints['left_e1']:.4f} rad")

others = {name: value for name, value in state.items() if name not in robot.joint_names}
posed = robot.at_rest(others)  # the other arm and the head stand where the robot says; collisions see them there
print(f"the right hand is at {posed.forward(q, 'right_gripper').translation.round(4)}, {mq.Solver(posed).engine_for()}")

locked = robot.locked({"left_w2": 0.3})  # six joints are left
s = mq.Solver(locked).solve(locked.forward(locked.middle + 0.1))
print(f"left_w2 locked: {s.status.name}, {locked.n} joints, {list(s.joints)}")
