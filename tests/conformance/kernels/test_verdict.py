"""Proofs of unreachable poses: never of what can be reached within the tolerances, nearly always of what cannot."""

from itertools import pairwise

import numpy as np
import pytest
from support.compiled_problems import few
from support.srs_arms import ARMS, anywhere, codes_of, hard_configurations, moved, poses_of, prepared, srs_arm

import maira_qp as mq
from maira_qp.analytic.srs.arcs import arcs
from maira_qp.kernels.srs.unreachability import ELBOW_OUTSIDE, POSSIBLE, SWIVEL_BLOCKED, TOO_FAR, TOO_NEAR

TOLERANCES = [(1e-6, 1e-6), (1e-3, 0.0), (0.0, 1e-3), (2e-3, 2e-3), (1e-9, 1e-9), (0.0, 0.0)]


@pytest.mark.parametrize("tolerances", TOLERANCES, ids=str)
@pytest.mark.parametrize("name", ARMS)
def test_what_is_within_the_tolerances_of_a_configuration_is_never_ruled_out(rng, name, tolerances):
    """Joints on their limits, stretched and folded arms, singular shoulders and wrists, moved by the tolerances."""
    arm = srs_arm(name)
    poses = poses_of(arm.robot, hard_configurations(arm, rng, few(400)))
    assert (codes_of(arm, poses, *tolerances) == POSSIBLE).all()
    assert (codes_of(arm, moved(poses, rng, *tolerances), *tolerances) == POSSIBLE).all()


@pytest.mark.parametrize("joint", range(7))
def test_poses_of_a_locked_joint_are_never_ruled_out(rng, joint):
    """Its solutions are points on the circle, each within the tolerance of being blocked."""
    for name in ("iiwa14", "wrapped"):
        robot = srs_arm(name).robot
        lower, upper = robot.lower.copy(), robot.upper.copy()
        lower[joint] = upper[joint] = robot.random_configuration(rng)[joint]
        locked = prepared(robot.limited(lower=lower, upper=upper))
        poses = poses_of(robot, hard_configurations(locked, rng, few(300)))
        assert (codes_of(locked, moved(poses, rng, 1e-6, 1e-6)) == POSSIBLE).all()


@pytest.mark.parametrize("name", ARMS)
def test_what_is_ruled_out_has_no_arcs_nor_has_anything_within_the_tolerances(rng, name):
    arm = srs_arm(name)
    for tolerance in (1e-6, 1e-3):
        poses = anywhere(arm, rng, few(200) + 60)
        poses = poses[codes_of(arm, poses, tolerance, tolerance) != POSSIBLE][: few(6)]
        assert len(poses) > 0
        for T in moved(poses, rng, tolerance, tolerance):
            assert arcs(arm.srs, T) == []


@pytest.mark.parametrize("name", ARMS)
def test_nearly_all_that_has_no_arcs_is_ruled_out(rng, name):
    """All but what is within about a hundred-thousandth of being reached."""
    arm = srs_arm(name)
    poses = anywhere(arm, rng, few(500) + 60)
    open_question = poses[codes_of(arm, poses) == POSSIBLE]
    for T in open_question[: few(12)]:
        assert arcs(arm.srs, T)


def test_the_reasons(rng):
    """Beyond the annulus, inside it, with the elbow outside, and else blocked on the circle; all of them occur."""
    arm = srs_arm("iiwa14")
    poses = anywhere(arm, rng, few(1000) + 400)
    codes, (smallest, largest) = codes_of(arm, poses), arm.srs.reach
    distance = np.array([np.linalg.norm(arm.srs.wrist_centre(T) - arm.srs.shoulder) for T in poses])
    np.testing.assert_array_equal(codes == TOO_FAR, distance > largest + 2e-6)
    assert (distance[codes == TOO_NEAR] < smallest).all()
    bent = np.array([np.linalg.norm(arm.srs.from_shoulder(q4)) for q4 in (arm.robot.upper[3], 0.0)])
    inside = (distance > smallest + 2e-6) & (distance < largest)
    np.testing.assert_array_equal(codes == ELBOW_OUTSIDE, inside & (distance < bent[0] - 1e-5))
    assert set(codes) == {POSSIBLE, TOO_FAR, TOO_NEAR, ELBOW_OUTSIDE, SWIVEL_BLOCKED}


def test_what_is_no_pose_is_not_ruled_out(rng):
    """Not a number, infinite, or with the wrist in the shoulder: no proof."""
    arm = srs_arm("maira")
    poses = np.tile(anywhere(arm, rng, 1), (24, 1, 1))
    for k in range(12):
        poses[2 * k, k // 4, k % 4], poses[2 * k + 1, k // 4, k % 4] = np.nan, np.inf
    assert (codes_of(arm, poses) == POSSIBLE).all()
    tip, at = arm.srs.tip, np.eye(4)
    at[:3, 3] = arm.srs.shoulder - tip[:3, :3].T @ (arm.srs.wrist - tip[:3, 3])
    free = prepared(arm.robot.limited(lower=[-2, -1, -2, -2, -1, -1, -1], upper=[2, 1, 2, 2, 1, 1, 1]))
    assert codes_of(free, at[None])[0] == POSSIBLE


def test_tighter_tolerances_rule_out_more(rng):
    arm = srs_arm("narrow")
    poses = anywhere(arm, rng, few(1000) + 50)
    proved = [codes_of(arm, poses, tolerance, tolerance) != POSSIBLE for tolerance in (0.0, 1e-6, 1e-4, 1e-3, 1e-2)]
    for tight, loose in pairwise(proved):
        assert not (loose & ~tight).any()
    assert proved[0].sum() > proved[-1].sum()


def test_the_solver_never_reaches_what_is_ruled_out(rng):
    """Poses at joint limits, moved by about the tolerance up to a hundredth."""
    for name in ("maira", "iiwa14"):
        arm = srs_arm(name)
        poses = poses_of(arm.robot, hard_configurations(arm, rng, few(60) + 20))
        size = 10.0 ** rng.uniform(-6, -2, len(poses))
        poses = np.array([moved(T[None], rng, step, step)[0] for T, step in zip(poses, size, strict=True)])
        ruled_out = codes_of(arm, poses) != POSSIBLE
        solved = mq.Solver(arm.robot, options=mq.Options(max_restarts=5)).solve_batch(poses).success
        assert not (solved & ruled_out).any()
        assert ruled_out.any()


def test_an_elbow_that_the_tolerance_brings_within_its_limits_is_not_ruled_out(rng):
    """Nearly stretched, where a change of the distance turns the elbow by more than its first order says.

    The target has the elbow at 0.1 rad; with the tool moved by the tolerance along the line to the wrist: at 0.052.
    """
    iiwa14 = mq.Robot.iiwa14()
    outer, inner = 0.1, 0.052
    arm = prepared(iiwa14.limited(lower={"joint4": -inner}, upper={"joint4": inner}))
    for _ in range(20):
        q = 0.5 * iiwa14.random_configuration(rng)
        q[3] = outer
        target, srs = iiwa14.forward(q), arm.srs
        line = srs.wrist_centre(target.homogeneous) - srs.shoulder
        longer = np.linalg.norm(srs.from_shoulder(inner)) - np.linalg.norm(line)
        moved_target = target.copy()
        moved_target.translation += longer * line / np.linalg.norm(line)
        near = [each for psi in np.linspace(-3, 3, 40) for each in srs.configurations(moved_target, psi)]
        within = [each for each in near if ((arm.robot.lower - 1e-9 <= each) & (each <= arm.robot.upper + 1e-9)).all()]
        if within:  # so it is reached to the tolerance, by kinematics alone
            off = np.linalg.norm(arm.robot.forward(arm.robot.clip(within[0])).translation - target.translation)
            assert off == pytest.approx(longer, rel=1e-5)
            assert codes_of(arm, [target.homogeneous], 1.001 * longer, 1e-6)[0] == POSSIBLE
            return
    raise AssertionError("no such pose was found")
