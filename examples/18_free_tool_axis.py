"""Three rounds on a circle with a nozzle that may turn about its own axis: what six axes gain from a free rotation."""

from math import pi

import numpy as np
from rich import print

import maira_qp as mq
from maira_qp.apps import plots

links = [  # an arm of six axes with the lengths of a UR5, each joint within ±180°
    mq.DHLink(d=0.0892, alpha=pi / 2),
    mq.DHLink(a=-0.425),
    mq.DHLink(a=-0.3922),
    mq.DHLink(d=0.1092, alpha=pi / 2),
    mq.DHLink(d=0.0947, alpha=-pi / 2),
    mq.DHLink(d=0.0823),
]
robot = mq.Robot.from_dh([mq.DHLink(a=row.a, alpha=row.alpha, d=row.d, lower=-pi, upper=pi) for row in links])
center = mq.pose([-0.45, 0.0, 0.2], rpy=[pi, 0, 0])  # the nozzle points down
angles = np.linspace(0.0, 6 * pi, 400)
tangent = [center * mq.pose([0.1 * np.cos(a), 0.1 * np.sin(a), 0.0], rpy=[0.2, 0.0, 0.0]) for a in angles]
rounds = [T * mq.pose(rpy=[0, 0, np.remainder(a + pi, 2 * pi) - pi]) for T, a in zip(tangent, angles, strict=True)]

whole = mq.Solver(robot)
free = mq.Solver(robot, task=mq.PoseTask(orientation_weight=[1, 1, 0], axes="target"))
paths = {"whole pose": whole.track(rounds), "free about z": free.track(rounds)}
for name, path in paths.items():
    verdict = "followed whole" if path else f"followed up to pose {path.first_failure}"
    print(f"{name}: {verdict}, largest step {path.max_joint_step:.3f} rad")
    if not path:
        print(f"  {path.reason}")

picture = plots.figure(1, 2, size=(10.0, 3.6))
for axes, (name, path) in zip(picture.axes, paths.items(), strict=True):
    plots.joint_paths(axes, robot, path.q)
    axes.set(xlabel="pose", title=name)
picture.suptitle("three rounds on a circle: a nozzle that may turn")
print(f"Picture: {plots.save(picture, 'output/18_free_tool_axis.png')}")
