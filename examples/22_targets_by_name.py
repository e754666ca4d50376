"""What changes from tick to tick, by name: a gaze point, a posture, a swivel angle, and a task that is faded out.

A solver is built once. Each call may give another datum for any of its tasks and objectives, and factors for their
weights; 0 switches one off. Such ticks stay in compiled code.
"""

import numpy as np

import maira_qp as mq

DT, TICKS = 0.01, 300

robot = mq.Robot.maira()
solver = mq.Solver(
    robot,
    task=mq.PositionTask(),
    tasks=[
        mq.LookAtTask(frame="tool0", point=[1.0, 0.0, 0.5], priority=2, name="gaze"),
        mq.SwivelTask(shoulder="link2", elbow="link4", wrist="link6", angle=0.0, priority=3),
    ],
    redundancy=mq.Strict(mq.Posture()),
)
print("names:", ", ".join(solver.names))

rest = robot.clip(np.radians([0, 40, 0, 80, 0, 40, 0]))
tool = robot.forward(rest)
q = rest.copy()
for tick in range(TICKS):
    t = tick * DT
    target = {
        "tool0": tool,  # the tool's point stays
        "gaze": [1.0, 0.4 * np.sin(t), 0.5],  # what it looks at moves
        "swivel": 0.3 * np.sin(2 * t),  # and so does the elbow
        "posture": rest + 0.1 * np.sin(t),
    }
    weights = {"gaze": max(0.0, 1.0 - t / 2)}  # after two seconds nothing is looked at any more
    step = solver.step(q, target, DT, weights=weights)
    q = step.q
    if tick % 60 == 0:
        print(f"t = {t:.1f} s: tool {1e3 * step.position_error:.3f} mm off, by the {step.backend} engine")

drift = np.linalg.norm(robot.forward(q).translation - tool.translation)
print(f"the tool's point moved by {1e6 * drift:.2f} micrometres")
assert step.backend == "compiled"
assert drift < 1e-4
