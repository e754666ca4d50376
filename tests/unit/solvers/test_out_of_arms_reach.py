"""What is said of targets that the arm is too short for, and of those that another orientation would do for."""

import numpy as np
import pytest
from support.robots import load

import maira_qp as mq


@pytest.mark.parametrize("name", ["panda", "ur5_limited", "xarm7"])
def test_an_arm_that_is_too_short_is_said_to_be_stretched_out(name):
    """Targets 5 cm to 1 m beyond where the tool ends, straight above the shoulder's axis or to the side of it."""
    robot = load(name)
    solver = mq.Solver(robot, options=mq.Options(max_restarts=20))
    far = mq.Solver(robot, task=mq.PositionTask())
    for way in ([1.0, 0.2, 0.1], [-0.3, 1.0, 0.5]):
        way = np.array(way) / np.linalg.norm(way)
        end = robot.forward(far.solve(100 * way).q)
        for beyond in (0.05, 1.0):
            s = solver.solve(mq.pose(end.translation + beyond * way, matrix=end.rotation))
            why = s.explain()
            assert not s.success
            assert why.is_stretched
            assert "stretched out toward the target" in str(why)
            assert why.position_alone == pytest.approx(beyond, rel=0.02)
            assert why.position_alone <= s.position_error + 1e-9


def test_a_position_that_another_orientation_reaches_is_said_to_be(maira):
    q = np.array([0.3, 0.6, 0.2, 0.5, 0.1, 0.2, 0.4])
    turned = maira.forward(q)
    turned.rotation = turned.rotation @ mq.pose(rpy=[np.pi, 0, 0]).rotation
    s = mq.Solver(maira).solve(turned)
    why = s.explain()
    assert not s.success
    assert why.position_alone == 0.0
    assert not why.is_stretched
    assert "In another orientation the tool reaches the position." in str(why)


def test_an_arm_that_folds_in_vain_or_stands_at_a_limit_is_not_stretched(maira):
    folded = mq.Solver(maira).solve(mq.pose(maira.forward(maira.middle, "link2").translation)).explain()
    assert folded.position_alone > 0.05
    assert not folded.is_stretched
    assert "In any orientation the tool ends" in str(folded)
    two = mq.Robot.from_dh([mq.DHLink(a=1.0, lower=-3, upper=3), mq.DHLink(a=0.8, lower=0.5, upper=2.5)])
    s = mq.Solver(two, task=mq.PoseTask(position_weight=1.0)).solve(mq.pose([3.0, 0, 0]))
    assert s.active_limits == ["joint2 lower"]
    assert not s.explain().is_stretched  # bent at its limit


@pytest.mark.parametrize("task", [mq.PositionTask(), mq.AxisTask(direction=[0, 0, 1])])
def test_nothing_is_said_of_tasks_that_are_no_pose(maira, task):
    s = mq.Solver(maira.limited(upper=maira.lower + 0.1), task=task).solve(
        {} if task.target_key is None else mq.pose([9, 0, 0])
    )
    assert s.explain().position_alone is None
