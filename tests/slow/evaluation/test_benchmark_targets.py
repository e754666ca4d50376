"""Targets: what each stratum promises, on arms of several kinds."""

import math

import numpy as np
import pytest

from maira_qp.errors import OptionError
from maira_qp.evaluation.runner import judge_of
from maira_qp.evaluation.settings import STRATA
from maira_qp.evaluation.targets import FAR_AWAY, MARGIN, NEARBY, NEARNESS, STEP, TargetSource
from maira_qp.robots.dh.table import DHLink, DHTable
from maira_qp.robots.model.robot import Robot

REACHABLE = [*(stratum for stratum in STRATA if stratum != "out-of-reach"), NEARBY]


def source_of(robot):
    return TargetSource(robot, judge_of(robot))


@pytest.fixture(scope="module")
def offset_arm():
    """A six-joint arm with lateral offsets, uneven limits, a continuous joint and a fixed tool."""
    links = [
        DHLink(d=0.3, alpha=-math.pi / 2, a=0.1, lower=-2.0, upper=1.0),
        DHLink(a=0.6, lower=-1.0, upper=2.5),
        DHLink(a=0.05, alpha=-math.pi / 2, lower=-2.8, upper=0.7),
        DHLink(d=0.5, alpha=math.pi / 2, kind="continuous"),
        DHLink(alpha=-math.pi / 2, lower=-1.5, upper=2.0),
        DHLink(d=0.1),
        DHLink(kind="fixed", a=0.05, theta=0.3, d=0.02),
    ]
    return Robot.from_dh(DHTable(links, name="offset"))


@pytest.mark.parametrize("stratum", REACHABLE)
def test_reachable_targets_have_a_witness_inside_the_limits(stratum, maira, offset_arm):
    """The configuration behind each target is inside the limits and reaches it, says Pinocchio too."""
    for robot in (maira, offset_arm):
        for index in range(10):
            target = source_of(robot).target(stratum, index, seed=3)
            assert target.reachable
            assert (robot.lower <= target.witness).all()
            assert (target.witness <= robot.upper).all()
            assert (robot.lower <= target.start).all()
            assert (target.start <= robot.upper).all()
            np.testing.assert_allclose(robot.forward(target.witness).homogeneous, target.pose, atol=1e-12)


@pytest.mark.parametrize(("stratum", "margin"), [("near-limits-1e-2", 1e-2), ("near-limits-1e-4", 1e-4)])
def test_near_limits_every_limited_joint_is_near_one(stratum, margin, maira, offset_arm):
    """No joint is further than the margin from a limit, both limits occur, and a continuous joint is free."""
    for robot in (maira, offset_arm):
        q = np.array([source_of(robot).target(stratum, i, seed=0).witness for i in range(40)])
        limited = np.isfinite(robot.lower)
        below, above = q - robot.lower, robot.upper - q
        assert (np.minimum(below, above)[:, limited] <= margin).all()
        assert ((below <= margin).any(axis=0) & (above <= margin).any(axis=0))[limited].all()
        assert np.ptp(q[:, ~limited], axis=0).min(initial=np.inf) > 1
        assert ((below > 0) & (above > 0))[:, limited].all()  # near them, not on them


def test_a_nearby_target_is_a_step_from_its_start(maira):
    """No further than that, and as far where no limit is in the way."""
    drawn = [source_of(maira).target(NEARBY, index, seed=1) for index in range(20)]
    steps = np.array([np.linalg.norm(target.witness - target.start) for target in drawn])
    assert steps.max() == pytest.approx(STEP)
    assert (steps > STEP / 2).all()


def test_a_batch_is_the_targets_one_by_one(maira):
    """And what is far away is further than any configuration comes."""
    source = source_of(maira)
    poses, starts = source.batch(FAR_AWAY, 5, seed=2)
    for index, (pose, start) in enumerate(zip(poses, starts, strict=True)):
        target = source.target(FAR_AWAY, index, seed=2)
        assert not target.reachable
        np.testing.assert_array_equal(pose, target.pose)
        np.testing.assert_array_equal(start, target.start)
    centre, reach = source.reach
    assert (np.linalg.norm(poses[:, :3, 3] - centre, axis=1) > 1.05 * reach).all()


def test_poses_around_what_is_reached_are_rigid_and_on_both_sides(maira):
    poses = source_of(maira).around(300, seed=0)
    np.testing.assert_allclose(
        np.swapaxes(poses[:, :3, :3], 1, 2) @ poses[:, :3, :3], np.tile(np.eye(3), (300, 1, 1)), atol=1e-9
    )
    centre, reach = source_of(maira).reach
    beyond = np.linalg.norm(poses[:, :3, 3] - centre, axis=1) > reach
    assert 0.02 < beyond.mean() < 0.5


def test_stretched_elbow_of_maira_is_its_fourth_joint(maira):
    """MAIRA's elbow is straight at zero, and there its Jacobian is nearly singular."""
    for index in range(20):
        q = source_of(maira).target("stretched-elbow", index, seed=1).witness
        assert abs(q[3]) <= NEARNESS
        assert maira.condition_number(q) > 500


def test_stretched_elbow_makes_any_arm_long(offset_arm):
    """No other value of the elbow takes the wrist further from the shoulder, to within what 1e-3 rad can do."""
    source = source_of(offset_arm)
    for index in range(10):
        q = source.target("stretched-elbow", index, seed=1).witness
        lengths = []
        for value in np.linspace(offset_arm.lower[2], offset_arm.upper[2], 500):
            other = q.copy()
            other[2] = value
            before, _ = source.judge.frames(other)
            lengths.append(np.linalg.norm(before[4, :3, 3] - before[1, :3, 3]))
        before, _ = source.judge.frames(q)
        assert np.linalg.norm(before[4, :3, 3] - before[1, :3, 3]) > max(lengths) - 1e-3


def test_aligned_wrist_of_maira_is_its_sixth_joint(maira):
    """MAIRA's wrist is aligned at zero: nearest to mid-range of the three places where it is."""
    for index in range(20):
        assert abs(source_of(maira).target("aligned-wrist", index, seed=1).witness[5]) <= NEARNESS


def test_aligned_wrist_of_a_six_joint_arm_is_singular(offset_arm):
    """An arm with no joint to spare loses a direction there."""
    for index in range(20):
        q = source_of(offset_arm).target("aligned-wrist", index, seed=1).witness
        assert abs(q[4]) <= NEARNESS
        assert offset_arm.condition_number(q) > 500


def test_an_aligned_wrist_may_be_folded_back():
    """Where the wrist's axes are opposed at mid-range and parallel nowhere inside the limits, that is singular."""
    links = [DHLink(d=0.3, alpha=-math.pi / 2), DHLink(a=0.4), DHLink(alpha=-math.pi / 2), DHLink(d=0.4, alpha=1.5)]
    wrist = [DHLink(alpha=-1.5, theta=math.pi, lower=-2.0, upper=2.0), DHLink(d=0.1)]
    robot = Robot.from_dh(DHTable([*links, *wrist]))
    source = source_of(robot)
    best = max(
        (abs(source.alignment(np.array([0, 0, 0, 0, value, 0]))), abs(value)) for value in np.linspace(-2, 2, 401)
    )[1]
    for index in range(5):
        q = source.target("aligned-wrist", index, seed=0).witness
        assert abs(abs(q[4]) - best) < 0.02


def test_nothing_reaches_beyond_the_reach(maira, iiwa14, offset_arm):
    """No random configuration puts the tool further from the centre than the bound, and the straight arm attains it."""
    rng = np.random.default_rng(0)
    sliding = Robot.from_dh(
        DHTable([DHLink(kind="prismatic", lower=-0.2, upper=0.6, alpha=0.7), DHLink(a=0.3), DHLink(a=0.2, d=0.1)])
    )
    rail = Robot.from_dh(
        DHTable([DHLink(a=0.3, alpha=0.4), DHLink(kind="prismatic", lower=-0.6, upper=0.1), DHLink(a=0.2)])
    )
    for robot in (maira, iiwa14, offset_arm, sliding, rail):
        centre, reach = source_of(robot).reach
        distances = [
            np.linalg.norm(robot.forward(robot.random_configuration(rng)).translation - centre) for _ in range(2000)
        ]
        assert max(distances) <= reach
        assert max(distances) > 0.6 * reach
    for robot in (maira, iiwa14):
        centre, reach = source_of(robot).reach
        assert np.linalg.norm(robot.forward(np.zeros(7)).translation - centre) == pytest.approx(reach, abs=1e-12)


def test_out_of_reach_is_just_out_of_reach(maira, offset_arm):
    """The target lies beyond the bound by the margin; on MAIRA the stretched arm comes to within the margin of it."""
    for robot in (maira, offset_arm):
        source = source_of(robot)
        centre, reach = source.reach
        for index in range(10):
            target = source.target("out-of-reach", index, seed=2)
            assert not target.reachable
            assert np.linalg.norm(target.pose[:3, 3] - centre) == pytest.approx(reach + MARGIN, abs=1e-12)
            np.testing.assert_allclose(target.pose[:3, :3] @ target.pose[:3, :3].T, np.eye(3), atol=1e-12)


def test_every_target_has_a_stream_of_its_own(maira):
    """A target depends on seed, stratum and number, and on nothing that was drawn before."""
    source = source_of(maira)
    for stratum in STRATA:
        fresh = TargetSource(maira, judge_of(maira)).target(stratum, 5, seed=9)
        for index in range(5):
            source.target(stratum, index, seed=9)
        again = source.target(stratum, 5, seed=9)
        assert (fresh.pose == again.pose).all()
        assert (fresh.start == again.start).all()
        assert fresh.seed == again.seed
        for other in (source.target(stratum, 6, seed=9), source.target(stratum, 5, seed=10)):
            assert not np.allclose(fresh.pose, other.pose)
            assert other.seed != fresh.seed
    starts = [source.target(stratum, 0, seed=9).start for stratum in STRATA]
    assert len({tuple(start) for start in starts}) == len(STRATA)


def test_arms_without_elbow_or_wrist():
    """A two-joint arm has neither; what it has not is told, and asking for it is an error."""
    source = source_of(Robot.from_dh(DHTable([DHLink(a=0.5), DHLink(a=0.4)])))
    assert source.missing("uniform") is None
    assert source.missing("out-of-reach") is None
    assert source.target("out-of-reach", 0, seed=0).witness is None
    for stratum in ("stretched-elbow", "aligned-wrist"):
        assert source.missing(stratum)
        with pytest.raises(OptionError, match="no stratum"):
            source.target(stratum, 0, seed=0)
    with pytest.raises(OptionError, match="did you mean 'uniform'"):
        source.missing("unifrom")


def test_a_locked_joint_stays_locked():
    """A joint with equal limits has one value in every stratum."""
    links = [DHLink(d=0.3, alpha=math.pi / 2), DHLink(a=0.4, lower=0.5, upper=0.5), DHLink(a=0.3)]
    source = source_of(Robot.from_dh(DHTable(links)))
    for stratum in ("uniform", "near-limits-1e-2", "stretched-elbow"):
        assert source.target(stratum, 0, seed=0).witness[1] == 0.5
