"""Proofs that a pose is unreachable, checked by sampling what they claim."""

import numpy as np
import pytest
from support.srs_arms import ARMS, Arm, anywhere, codes_of, prepared, srs_arm

import maira_qp as mq
from maira_qp.analytic.srs.geometry import BRANCHES
from maira_qp.analytic.srs.unreachability import Reason, SwivelProof, swivel_proof

TOLERANCE = {"position_tolerance": 1e-6, "orientation_tolerance": 1e-6}


def is_outside(robot: mq.Robot, joint: int, angle: np.ndarray) -> np.ndarray:
    """Whether a joint at angles (N,), up to whole turns, is outside its limits, or has no angle (NaN)."""
    turns = np.arange(-5, 6) * 2 * np.pi
    candidates = np.asarray(angle)[:, None] + turns
    return ~((robot.lower[joint] <= candidates) & (candidates <= robot.upper[joint])).any(axis=1)


def check(arm: Arm, T: np.ndarray, found: SwivelProof) -> None:
    """All that a proof claims, by other means than those that found it."""
    if found.reason in (Reason.TOO_FAR, Reason.TOO_NEAR):
        beyond = found.distance - found.reach[1], found.reach[0] - found.distance
        assert beyond[0 if found.reason == Reason.TOO_FAR else 1] > 1e-6
        return
    elbows = {elbow.sign: elbow for elbow in arm.srs.elbow_branches(T)}
    assert tuple(one.branch for one in found.branches) == BRANCHES
    for one in found.branches:
        elbow, place = elbows[one.branch.elbow], BRANCHES.index(one.branch) % 4
        assert one.q4 == elbow.q4
        assert one.intervals[0].lower == -np.pi
        assert one.intervals[-1].upper == np.pi
        for before, after in zip(one.intervals[:-1], one.intervals[1:], strict=True):
            assert after.lower == before.upper
        for interval in one.intervals:
            psi = np.linspace(interval.lower, interval.upper, 50)
            q = arm.srs.evaluate(elbow, psi)[:, place]
            if interval.joint == 3:
                assert is_outside(arm.robot, 3, np.array([one.q4])).all()
            elif interval.limit == "no solution":
                assert np.isnan(q).all()
            else:
                assert is_outside(arm.robot, interval.joint, q[:, interval.joint]).all()


@pytest.mark.parametrize("name", ARMS)
def test_a_proof_holds_what_it_claims(rng, name):
    """On every interval of every branch."""
    arm = srs_arm(name)
    poses = anywhere(arm, rng, 200)
    codes = codes_of(arm, poses)
    for T in [*poses[codes > 3][:5], *poses[codes == 3][:2], *poses[(codes == 1) | (codes == 2)][:2]]:
        found = swivel_proof(arm.srs, T, **TOLERANCE)
        assert found is not None
        check(arm, T, found)


def test_there_is_a_proof_where_there_is_a_verdict(rng):
    arm = srs_arm("iiwa14")
    poses = anywhere(arm, rng, 60)
    found = [swivel_proof(arm.srs, T, **TOLERANCE) for T in poses]
    assert [0 if each is None else int(each.reason) for each in found] == codes_of(arm, poses).tolist()


def test_the_joints_that_stand_in_the_way_are_named(rng):
    """An arm whose third joint alone is narrow, and poses that it would take another angle of that joint to reach."""
    full = mq.Robot.iiwa14().limited(lower={"joint3": 0.2}, upper={"joint3": 0.21})
    arm, named = prepared(full), set()
    for q in np.array([full.random_configuration(rng) for _ in range(40)]):
        q[2] = -2.0
        found = swivel_proof(arm.srs, full.forward(q), **TOLERANCE)
        named |= set() if found is None else set(found.limits)
    assert {joint for joint, _ in named} >= {2}
    assert all(limit in ("lower", "upper") for _, limit in named)


def test_an_elbow_that_cannot_bend_far_enough_is_named():
    """Both elbow angles are given, and both are outside."""
    robot = mq.Robot.maira()
    q = np.array([0.1, 0.5, -0.3, 2.0, 0.4, 0.6, 0.2])
    arm = prepared(robot.limited(lower={"joint4": -1.5}, upper={"joint4": 1.5}))
    found = swivel_proof(arm.srs, robot.forward(q), **TOLERANCE)
    assert found is not None
    assert found.reason == Reason.ELBOW
    assert found.limits == ((3, "lower"), (3, "upper"))
    np.testing.assert_allclose(sorted({one.q4 for one in found.branches}), [-2.0, 2.0], atol=1e-12)


def test_a_bad_pose_is_refused(rng):
    with pytest.raises(mq.errors.PoseError, match="target"):
        swivel_proof(srs_arm("maira").srs, np.full((4, 4), np.nan), **TOLERANCE)
