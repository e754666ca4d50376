"""Every solution for a pose, for four kinds of arms, and the one that is closest to where the arm stands."""

from importlib.metadata import distribution
from pathlib import Path

import numpy as np

import maira_qp as mq

data = Path(distribution("example-robot-data").locate_file("cmeel.prefix/share/example-robot-data/robots"))
arms = {
    "S-R-S, seven joints": mq.Robot.maira(),
    "six joints": mq.Robot.from_urdf(data / "ur_description/urdf/ur5_joint_limited_robot.urdf", tip="tool0"),
    "six joints, each of up to two turns": mq.Robot.from_urdf(
        data / "ur_description/urdf/ur10_robot.urdf", tip="tool0"
    ),
    "seven joints, not S-R-S": mq.Robot.from_urdf(data / "panda_description/urdf/panda.urdf", tip="panda_hand_tcp"),
}
rng = np.random.default_rng(13)

for name, robot in arms.items():
    solver = mq.Solver(robot)
    target = robot.forward(robot.random_configuration(rng))
    solutions = solver.solutions(target)  # the best first: nearest to the middle of the limits
    print(f"\n{robot.name} ({name})")
    print(*repr(solutions).splitlines()[:6], sep="\n")

    q0 = robot.random_configuration(rng)
    first = solver.solve(target, q0)  # any solution: the one that a search from q0 arrives at
    closest = solver.solve(target, q0, prefer="closest")
    stiff = solver.solve(target, q0, prefer="closest", metric=[10.0, *np.ones(robot.n - 1)])  # the base is to stay
    for title, s in (("from q0", first), ("closest", closest), ("closest, base x 10", stiff)):
        moved = np.abs(s.q - q0)
        print(f"{title:18s}: |q - q0| = {np.linalg.norm(moved):6.3f} rad, of which the base {moved[0]:6.3f}")
