"""The compiled closed form of S-R-S arms against `SRS`, its arcs, and Pinocchio."""

import numpy as np
import pytest
from support.compiled_problems import few, row_of
from support.srs_arms import (
    ARMS,
    Arm,
    anywhere,
    codes_of,
    hard_configurations,
    memory,
    moved,
    poses_of,
    prepared,
    random_rotation,
    srs_arm,
    starts_of,
)

import maira_qp as mq
from maira_qp.analytic.srs.arcs import arcs, from_seam, is_inside
from maira_qp.analytic.srs.geometry import ElbowBranch, wrapped
from maira_qp.kernels.layout import Arc, Axis, Part
from maira_qp.kernels.srs.spherical_joint import angle, discriminant
from maira_qp.kernels.srs.swivel import approach, bend, branch_at, swing, values_at
from maira_qp.kernels.srs.swivel_intervals import INTERVALS, block


def circles_of(arm: Arm, T: np.ndarray, elbow: ElbowBranch) -> np.ndarray:
    """The sinusoids (2, 15) of shoulder and wrist."""
    base, circles = np.full((2, 9), np.nan), np.full((2, 15), np.nan)
    cosine, sine = bend(arm.array, approach(arm.array, row_of(T), base))
    assert swing(arm.array, base, cosine, sine, float(elbow.sign), circles)
    return circles


def angles_at(arm: Arm, circles: np.ndarray, part: int, psi: float, tau: float) -> np.ndarray:
    """The joint angles (3,) of shoulder or wrist, in the order of the chain; NaN without a solution."""
    joint = arm.array[Part.SHOULDER + part]
    z, p, r, p_last, r_last = values_at(circles, part, np.cos(psi), np.sin(psi))
    square = discriminant(joint, Axis.FIRST, z, p, r)
    assert discriminant(joint, Axis.LAST, z, p_last, r_last) == pytest.approx(square, abs=1e-14)
    if square < 0:
        return np.full(3, np.nan)
    q = [angle(joint, k, z, p, r, square, tau) for k in (Axis.FIRST, Axis.MIDDLE)]
    q = np.array([*q, angle(joint, Axis.LAST, z, p_last, r_last, square, tau)])
    return q if part == 0 else q[::-1]


@pytest.mark.parametrize("name", ARMS)
def test_the_angles_are_those_of_the_exact_twin(rng, name):
    """At any swivel angle, on all branches, or there are none; and a branch is named where one is within the limits."""
    arm = srs_arm(name)
    for T in poses_of(arm.robot, [arm.robot.random_configuration(rng) for _ in range(few(60))]):
        for elbow in arm.srs.elbow_branches(T):
            circles, psi = circles_of(arm, T, elbow), rng.uniform(-np.pi, np.pi)
            turns = elbow.shoulder.at(np.array(psi)), elbow.wrist.at(np.array(psi))
            for part, (joint, R) in enumerate(zip(arm.srs.joints, turns, strict=True)):
                expected, chain = joint.decompose(R), slice(0, 3) if part == 0 else slice(4, 7)
                found = np.array([angles_at(arm, circles, part, psi, tau) for tau in (1.0, -1.0)])
                np.testing.assert_array_equal(np.isnan(found), np.isnan(expected))
                np.testing.assert_allclose(wrapped(found - expected)[~np.isnan(found)], 0, atol=1e-8)
                inside = [not np.isnan(q).any() and is_within(arm.robot, chain, q) for q in expected]
                tau = branch_at(arm.array, circles, part, np.cos(psi), np.sin(psi))
                assert tau == (1 if inside[0] else -1 if inside[1] else 0)


def is_within(robot: mq.Robot, joints: slice, q: np.ndarray) -> bool:
    """Whether angles (k,) of some joints are within the limits, give or take whole turns."""
    turned = q + 2 * np.pi * np.arange(-3, 4)[:, None]
    return bool(((robot.lower[joints] <= turned) & (turned <= robot.upper[joints])).any(axis=0).all())


@pytest.mark.parametrize("name", ARMS)
def test_what_is_blocked_without_a_margin_is_what_is_outside(rng, name):
    """2,000 samples on each arm: a branch is on a blocked arc, or it is within the limits."""
    arm = srs_arm(name)
    outside = 0
    for T in anywhere(arm, rng, few(40) + 10):
        for elbow in arm.srs.elbow_branches(T):
            work = INTERVALS.plain(*memory())
            block(arm.array, circles_of(arm, T, elbow), 0.0, 0.0, work)
            psi = rng.uniform(-np.pi, np.pi, 50)
            q = arm.srs.evaluate(elbow, psi)
            q[..., 3] = arm.robot.lower[3] if np.isfinite(arm.robot.lower[3]) else 0.0
            inside = is_inside(arm.srs, from_seam(arm.srs, q))
            for k in range(4):
                lists = [
                    work.arcs[part, branch, : work.lengths[part, branch]] for part, branch in ((0, k // 2), (1, k % 2))
                ]
                ends = np.concatenate(lists)[:, : Arc.UPPER + 1]
                on = (
                    np.mod(psi[:, None] - ends[:, Arc.LOWER], 2 * np.pi) <= ends[:, Arc.UPPER] - ends[:, Arc.LOWER]
                ).any(axis=1)
                np.testing.assert_array_equal(on, ~inside[:, k])
                outside += int(on.sum())
    assert outside > 0 or name == "continuous"


@pytest.mark.parametrize("eta", [1e-3, 0.02])
@pytest.mark.parametrize("name", ARMS)
def test_what_is_blocked_with_a_margin_stays_outside_within_it(rng, name, eta):
    """Rotations of shoulder and wrist by up to the margin leave the joint outside, or without a solution."""
    arm, seen = srs_arm(name), 0
    for T in anywhere(arm, rng, few(16) + 4):
        for elbow in arm.srs.elbow_branches(T):
            work = INTERVALS.plain(*memory())
            block(arm.array, circles_of(arm, T, elbow), eta, eta, work)
            for part, circle in enumerate((elbow.shoulder, elbow.wrist)):
                for branch in range(2):
                    for lower, upper, reason in work.arcs[part, branch, : work.lengths[part, branch]]:
                        share = np.array([0.0, 0.0, 0.0, 0.001, 0.5, 0.999, 1.0, 1.0, 1.0])
                        R = circle.at(lower + share * (upper - lower))
                        turned = np.array([random_rotation(rng, 0.999 * eta) @ each for each in R])
                        q = arm.srs.joints[part].decompose(turned)[:, branch, int(reason) // 3 - 4 * part]
                        joint = slice(int(reason) // 3, int(reason) // 3 + 1)
                        assert not any(is_within(arm.robot, joint, each[None]) for each in q)
                        seen += 1
    assert seen > 0 or name == "continuous"


@pytest.mark.parametrize("name", ARMS)
def test_a_start_reaches_the_pose_within_the_limits(rng, name):
    """To 1e-12, and inside to the bit; wherever a pose is one of the arm's, from every offset."""
    arm = srs_arm(name)
    poses = poses_of(arm.robot, np.array([arm.robot.random_configuration(rng) for _ in range(few(400))]))
    for offset in (0.3, -2.0, 7.0):
        q, found = starts_of(arm, poses, offset)
        assert found.all()
        assert ((arm.robot.lower <= q) & (q <= arm.robot.upper)).all()
        np.testing.assert_allclose(poses_of(arm.robot, q), poses, rtol=0, atol=1e-12 * max(1, arm.robot.length))


@pytest.mark.parametrize("name", ARMS)
def test_a_start_is_found_where_there_are_arcs(rng, name):
    """And only there."""
    arm = srs_arm(name)
    poses = anywhere(arm, rng, few(200) + 40)
    q, found = starts_of(arm, poses)
    assert not found[codes_of(arm, poses) != 0].any()
    for T in poses[~found][: few(4)]:
        assert max((arc.length for arc in arcs(arm.srs, T)), default=0.0) < 1e-6
    np.testing.assert_allclose(poses_of(arm.robot, q[found]), poses[found], rtol=0, atol=1e-12 * arm.robot.length)


@pytest.mark.parametrize("name", ARMS)
def test_a_start_is_never_wrong(rng, name):
    """Joints on limits, stretched, folded, singular: nothing, or a configuration of the arm that reaches the pose."""
    arm = srs_arm(name)
    poses = poses_of(arm.robot, hard_configurations(arm, rng, few(400)))
    for some in (poses, moved(poses, rng, 1e-9, 1e-9)):
        q, found = starts_of(arm, some)
        assert found.any()
        assert ((arm.robot.lower <= q) & (q <= arm.robot.upper))[found].all()
        np.testing.assert_allclose(poses_of(arm.robot, q[found]), some[found], rtol=0, atol=1e-10)


def test_slivers_are_found(rng):
    """With one joint that may turn by a millionth, and all others free as they are."""
    robot, width = srs_arm("iiwa14").robot, 1e-6
    for joint in (0, 1, 2, 4, 5, 6):
        q = np.array([0.3, 0.7, -0.4, 1.2, 0.5, -0.8, 0.2])
        lower, upper = robot.lower.copy(), robot.upper.copy()
        lower[joint], upper[joint] = q[joint] - 0.3 * width, q[joint] + 0.7 * width
        arm = prepared(robot.limited(lower=lower, upper=upper))
        found, success = starts_of(arm, poses_of(robot, q[None]))
        assert success[0]
        assert lower[joint] <= found[0, joint] <= upper[joint]


def test_turns_are_those_nearest_to_the_middle(rng):
    """In a range of several turns the angle within half a turn of its middle, of a continuous joint in (-pi, pi]."""
    for name in ("more than a turn", "continuous"):
        arm = srs_arm(name)
        q, found = starts_of(arm, poses_of(arm.robot, hard_configurations(arm, rng, few(300))))
        assert (np.abs(q - arm.robot.middle)[found] <= np.pi).all()
        assert (q[found][:, np.isinf(arm.robot.lower)] > -np.pi).all()


def test_no_pose_has_no_start(rng):
    """Beyond reach, not a number, or with the wrist in the shoulder."""
    arm = srs_arm("maira")
    far, nan, centre = np.tile(np.eye(4), (3, 1, 1))
    far[:3, 3], nan[0, 0] = 5.0, np.nan
    centre[:3, 3] = arm.srs.shoulder - arm.srs.tip[:3, :3].T @ (arm.srs.wrist - arm.srs.tip[:3, 3])
    assert not starts_of(arm, np.array([far, nan, centre]))[1].any()
