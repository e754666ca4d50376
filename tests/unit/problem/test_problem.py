"""A problem is data: what is asked of a robot, bound to it, and what does not change from call to call."""

import pickle
from dataclasses import FrozenInstanceError

import numpy as np
import pytest

import maira_qp as mq
from maira_qp.errors import FrameError, OptionError, PoseError
from maira_qp.problem.problem import Problem

BOX = mq.LinearLimit(np.eye(7)[:2], np.array([0.5, 0.5]))


def test_a_problem_is_frozen_and_its_variants_leave_it_as_it_is(maira):
    problem = Problem.build(maira, redundancy=mq.Strict(mq.Posture()))
    with pytest.raises(FrozenInstanceError):
        problem.options = mq.Options()
    other = problem.with_redundancy(None).with_options(max_restarts=3)
    assert (other.redundancy, other.options.max_restarts) == (None, 3)
    assert problem.redundancy is not None
    assert problem.options == mq.Options()
    assert other.is_pose_alone
    assert not problem.is_pose_alone
    assert other.robot is problem.robot


def test_the_posture_is_the_first_among_the_objectives_wherever_it_stands(maira):
    q = np.linspace(-0.5, 0.5, 7)
    below = mq.ObjectiveTask(mq.Posture(q), priority=2)
    for problem in (
        Problem.build(maira, redundancy=mq.Strict(mq.Manipulability(), mq.Posture(q))),
        Problem.build(maira, tasks=[below]),
    ):
        np.testing.assert_array_equal(problem.posture.q_ref, q)
    assert Problem.build(maira).posture is None


def test_limits_that_are_stood_on_and_broken_are_named(maira):
    problem = Problem.build(maira, limits=[BOX])
    q = maira.middle.copy()
    q[0], q[6] = 0.8, maira.upper[6]
    assert "joint7 upper" in problem.active_limits(q)
    ((name, amount),) = problem.limit_violations(maira.at(q)).items()
    assert "LinearLimit" in name
    assert amount == pytest.approx(0.3)
    assert problem.limit_violations(maira.at(maira.middle)) == {}
    assert len(problem.limits) == 4


def test_errors_are_within_the_tolerances_or_not_as_numbers_and_as_arrays(maira):
    problem = Problem.build(maira, options=mq.Options(position_tolerance=1e-3, orientation_tolerance=1e-2))
    assert problem.is_reached(1e-3, 1e-2)
    assert not problem.is_reached(1.1e-3, 0.0)
    assert problem.is_reached(np.array([0, 2e-3, 0]), np.array([0, 0, 0.02])).tolist() == [True, False, False]


def test_targets_of_one_call_and_of_many_are_of_one_type(maira, rng):
    problem = Problem.build(maira, task=[mq.PoseTask(), mq.PositionTask(frame="link4")])
    poses = [
        {frame: maira.forward(q, frame) for frame in problem.target_keys}
        for q in (maira.random_configuration(rng) for _ in range(3))
    ]
    many, one = problem.targets(poses), problem.target(poses[1])
    assert (len(many), len(one), many.keys) == (3, 1, problem.target_keys)
    np.testing.assert_allclose(many[1].rows, one.rows, atol=1e-14)
    for frame, pose in one.poses().items():
        np.testing.assert_allclose(pose.homogeneous, poses[1][frame].homogeneous, atol=1e-14)
    assert many.is_finite.all()
    with pytest.raises(FrameError, match="tool0"):
        problem.target({"elbow": poses[0][problem.target_keys[0]]})
    with pytest.raises(PoseError, match="link4"):
        problem.target({problem.target_keys[0]: poses[0][problem.target_keys[0]]})


def test_what_no_problem_is_made_of_is_refused(maira):
    for arguments, word in (
        ({"tasks": "pose"}, "a list"),
        ({"limits": [1.0]}, "LinearLimit"),
        ({"options": 3}, "Options"),
        ({"redundancy": mq.Posture()}, "Strict"),
        ({"redundancy": mq.Weighted(mq.Posture()), "tasks": [mq.PositionTask(priority=2)]}, "Weighted"),
    ):
        with pytest.raises(OptionError, match=word):
            Problem.build(maira, **arguments)


def test_a_problem_pickles(maira):
    problem = pickle.loads(pickle.dumps(Problem.build(maira, limits=[BOX], redundancy=mq.Strict(mq.Posture()))))
    assert problem.robot.joint_names == maira.joint_names
    assert len(problem.additional_limits) == 1
