"""Limbs that share no joint: found from the tasks, and solved together as often as each alone."""

import numpy as np
import pytest
from support.robots import load

import maira_qp as mq
from maira_qp.problem.qp.costs import tasks_toward
from maira_qp.solvers.limbs import limbs_of

LEGS = 8


def legged(legs: int, rng: np.random.Generator) -> mq.Robot:
    """A body with legs of six joints each, with axes and offsets at random, of a small range."""
    links, joints = ['<link name="body"/>'], []
    for leg in range(legs):
        parent = "body"
        for k in range(6):
            child, axis, offset = f"leg{leg}_{k}", rng.normal(size=3), 0.4 * rng.normal(size=3)
            links.append(f'<link name="{child}"/>')
            joints.append(
                f'<joint name="{child}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
                f'<origin xyz="{" ".join(map(str, offset))}"/><axis xyz="{" ".join(map(str, axis))}"/>'
                '<limit lower="-1.5" upper="1.5" velocity="3" effort="1"/></joint>'
            )
            parent = child
    text = f'<robot name="legged">{"".join(links + joints)}</robot>'
    return mq.Robot.from_urdf(text, tip=[f"leg{leg}_5" for leg in range(legs)], base="body")


def limbs_by_joints(robot: mq.Robot, tasks: list) -> list[set[str]]:
    """The names of the joints of each limb, the targets wherever the frames are at the middle."""
    tasks = [task.of(robot) for task in tasks]
    targets = {f: robot.forward(robot.middle, f) for task in tasks if (f := task.target_key) is not None}
    limbs = limbs_of(tasks_toward(tasks, targets), robot)
    return [{robot.joint_names[i] for i in np.flatnonzero(limb.joints)} for limb in limbs]


def test_limbs_are_joined_by_joints_and_by_tasks(rng):
    robot = legged(3, rng)
    legs = [{f"leg{leg}_{k}" for k in range(6)} for leg in range(3)]
    poses = [mq.PoseTask(frame=tip) for tip in robot.tips]
    assert limbs_by_joints(robot, poses) == legs
    assert limbs_by_joints(robot, poses[:2]) == legs[:2]
    coupling = mq.JointCouplingTask(coefficients={"leg0_0": 1.0, "leg2_0": -1.0})
    assert limbs_by_joints(robot, [*poses, coupling]) == [legs[1], legs[0] | legs[2]]
    held = mq.RelativePoseTask(frame=robot.tips[1], reference=robot.tips[0], target=np.eye(4))
    assert limbs_by_joints(robot, [*poses, held]) == [legs[2], legs[0] | legs[1]]
    wish = mq.LimitTask(limit=mq.LinearLimit(np.eye(18)[:1], [0.0]))
    assert len(limbs_by_joints(robot, [*poses, wish])) == 1


def test_arms_on_a_torso_are_one_limb_and_legs_are_others():
    robot = load("talos_whole")
    limbs = limbs_by_joints(robot, [mq.PoseTask(frame=tip) for tip in robot.tips])
    assert sorted(map(len, limbs)) == [6, 6, 18]


@pytest.mark.parametrize("start", [False, True])
def test_limbs_are_solved_together_as_often_as_alone(start, rng):
    """With restarts enough for one limb, and by far too few for attempts that must succeed for all at once."""
    robot, few, solved, alone = legged(LEGS, rng), mq.Options(max_restarts=40), 0, 0
    together = mq.Solver(robot, options=few)
    for k in range(4):
        goal = robot.random_configuration(rng)
        q0 = robot.random_configuration(rng) if start else None
        targets = {tip: robot.forward(goal, tip) for tip in robot.tips}
        s = together.solve(targets, q0)
        solved += s.success
        assert s.restarts <= few.max_restarts
        error = max(np.abs(mq.pose_error(robot.forward(s.q, tip), targets[tip])).max() for tip in robot.tips)
        assert s.success == (error <= 1e-6)
        if k < 1:
            each = [
                mq.Solver(robot, task=mq.PoseTask(frame=tip), options=few).solve(targets[tip], q0) for tip in robot.tips
            ]
            alone += all(s.success for s in each)
    assert alone == 1
    assert solved == 4


def test_limits_that_join_limbs_hold(rng):
    """Two legs, each of which would reach its target, with a sum of joints that both must keep."""
    robot = legged(2, rng)
    row = np.zeros((1, 12))
    row[0, [0, 6]] = 1.0
    limit, solved = mq.LinearLimit(row, [0.0]), 0
    solver = mq.Solver(robot, limits=[limit])
    for _ in range(4):
        goal = robot.random_configuration(rng)
        goal[[0, 6]] = -np.abs(goal[[0, 6]])
        s = solver.solve({tip: robot.forward(goal, tip) for tip in robot.tips})
        solved += s.success
        assert s.q[0] + s.q[6] <= 1e-9
    assert solved >= 3
