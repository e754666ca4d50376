"""Change the tool, mount the robot on a table, take targets from a camera: tool offset (TCP), base frame, hand-eye."""

import numpy as np
from rich import print

import maira_qp as mq

robot = mq.Robot.maira()
solver = mq.Solver(robot)
point = mq.pose([0.5, 0.1, 0.6], rpy=[np.pi, 0, 0])  # where the tool's tip is to be, pointing down

gripper = mq.pose([0, 0, 0.12])  # T_tip_tool: where the tool's tip is in the flange
driver = mq.pose([0.05, 0, 0.2], rpy=[0, 0.3, 0])
for name, tool in (("gripper", gripper), ("screwdriver", driver)):
    s = solver.solve(point, tool=tool)  # for this call; robot.with_tool(tool) and Robot.from_urdf(..., tool=tool) stay
    print(f"{name}: {s.status.name}, its tip is at {(robot.forward(s.q) * tool).translation.round(6)}")

table = mq.pose([1.0, 2.0, 0.8], rpy=[0, 0, np.pi / 2])  # T_room_base: where the arm stands in the room
mounted = mq.Solver(robot.with_tool(gripper).with_base(table, name="room"))
s = mounted.solve(table * point)  # targets are poses in the room now
print(f"on the table: {s.status.name}, {mounted.robot.title}")

cart = np.array([mq.pose([x, 0.0, 0.0]).homogeneous for x in np.linspace(-1.0, 1.0, 9)])
reached = solver.solve_batch(point.homogeneous, base=cart).success  # a base for each target, or for this one
print(f"a cart along x reaches it from {reached.sum()} of {len(cart)} places")

q = robot.configuration({"joint2": 0.4, "joint4": 1.5, "joint6": 0.9}, default=robot.middle)
seen = mq.pose([0.05, 0.0, 0.3])  # what the camera sees, which is on link6 and moves with it
s = solver.solve(seen, q, in_frame="link6")
print(f"seen by the camera: {s.status.name}, in the base at {(robot.forward(q, 'link6') * seen).translation.round(4)}")
