"""The self-motion of redundant arms, as the viewer walks it: the tool stands still, and the way ends where it must."""

import numpy as np
import pytest
from support.robots import load

import maira_qp as mq
from maira_qp.analytic.srs.geometry import SRS
from maira_qp.apps.viewer.motion.elbow import elbow_of
from maira_qp.apps.viewer.motion.self_motion import LONGEST, is_redundant, self_motion

ROBOTS = {name: load(name) for name in ("panda", "xarm7", "tiago")}


@pytest.mark.parametrize("name", ROBOTS)
def test_the_tool_stands_still_within_the_limits_wherever_the_slider_is(name, rng):
    robot = ROBOTS[name]
    for _ in range(3):
        q = robot.random_configuration(rng)
        motion, tool = self_motion(robot, q), robot.forward(q)
        assert (np.diff(motion.s) > 0).all()
        places = np.linspace(motion.lower, motion.upper, 500)
        found = motion.at(places)
        assert ((robot.lower <= found) & (found <= robot.upper)).all()
        assert max(np.abs(mq.pose_error(robot.forward(at), tool)).max() for at in found) < 1e-6
        np.testing.assert_array_equal(motion.at(np.array(0.0)), q)
        # s is the length of the way: the slider moves the arm everywhere, and at the same speed (chords cut its bends)
        speed = np.linalg.norm(np.diff(found, axis=0), axis=1) / np.diff(places)
        np.testing.assert_allclose(speed, 1, atol=0.02)


@pytest.mark.parametrize("name", ROBOTS)
def test_the_way_ends_at_limits(name, rng):
    robot = ROBOTS[name]
    for _ in range(3):
        motion = self_motion(robot, robot.random_configuration(rng))
        for end, side in ((motion.q[0], motion.lower), (motion.q[-1], motion.upper)):
            room = np.minimum(end - robot.lower, robot.upper - end).min()
            assert room < 1e-9 or abs(side) >= LONGEST or motion.is_closed


def test_it_is_the_arc_that_the_closed_form_knows(iiwa14, rng):
    """The same curve, from another method: the same branch all along, and the same ends."""
    srs = SRS.of(iiwa14)
    for _ in range(4):
        q = iiwa14.random_configuration(rng)
        arc, motion = elbow_of(srs, q).curve, self_motion(iiwa14, q)
        ends = sorted(arc.at(np.array(end)).tolist() for end in (arc.lower, arc.upper))
        np.testing.assert_allclose(sorted(motion.q[[0, -1]].tolist()), ends, atol=1e-6)
        for at in motion.at(np.linspace(motion.lower, motion.upper, 9)[1:-1]):
            assert elbow_of(srs, at).curve.branch == arc.branch


def test_a_way_that_meets_its_beginning_is_closed(rng):
    robot = ROBOTS["panda"]
    motions = [self_motion(robot, robot.random_configuration(rng)) for _ in range(6)]
    closed = [motion for motion in motions if motion.is_closed]
    assert 0 < len(closed) < 6
    for motion in closed:
        np.testing.assert_array_equal(motion.q[0], motion.q[-1])
        np.testing.assert_array_equal(motion.directions[0], motion.directions[-1])
        assert np.abs(motion.at(np.array(0.5 * motion.upper)) - motion.q[0]).max() > 0.1


def test_a_joint_that_stands_on_a_limit_leaves_it_to_the_other_side_alone(rng):
    robot = ROBOTS["panda"]
    motion = self_motion(robot, robot.random_configuration(rng))
    again = self_motion(robot, motion.q[0])
    assert min(abs(again.lower), again.upper) == 0
    assert again.upper - again.lower == pytest.approx(motion.upper - motion.lower, abs=1e-3)


def test_six_joints_have_none_and_a_locked_joint_does_not_count(ur5):
    panda = ROBOTS["panda"]
    assert not is_redundant(ur5)
    assert is_redundant(panda)
    assert not is_redundant(panda.limited(lower={"panda_joint3": 0.3}, upper={"panda_joint3": 0.3}))
