"""S-R-S arms in closed form: what counts as one, and all of its configurations for a pose."""

import numpy as np
import pinocchio as pin
import pytest
from support.robots import load
from support.srs_arms import iiwa14_without_offset, random_arm, random_direction, swivel_of, worst_error

import maira_qp as mq
from maira_qp.analytic.srs.geometry import PARALLEL_WITHIN, SRS, SphericalJoint, rotations, wrapped
from maira_qp.problem.tasks.swivel import SwivelTask

NOT_SRS = {
    "panda": "the wrist",
    "xarm7": "the shoulder",
    "talos_arm": "the shoulder",
    "pr2_arm": "the shoulder",
    "baxter": "the shoulder",
    "tiago": "7 joints",
    "irb140": "7 joints",
}


@pytest.fixture(scope="module")
def arms() -> list[mq.Robot]:
    """Arms that are S-R-S: those of the catalog, a real URDF, and three at random."""
    pin.seed(1)
    rng = np.random.default_rng(1)
    return [mq.Robot.maira(), mq.Robot.iiwa14(), iiwa14_without_offset(), *(random_arm(rng) for _ in range(3))]


@pytest.mark.parametrize(("name", "part"), NOT_SRS.items())
def test_arms_with_offsets_are_told_apart(name, part):
    """No real arm with an offset is taken for S-R-S, however small the offset, and the reason names the part."""
    robot = load(name)
    assert SRS.of(robot) is None
    assert part in str(SRS.refusal(robot))


def test_the_offset_in_the_urdf_of_iiwa14_is_seen():
    """Its A2 stands 0.44 mm beside A1, so this URDF is no S-R-S arm; without that, it is."""
    assert "shoulder" in str(SRS.refusal(load("iiwa14_urdf")))
    assert SRS.refusal(iiwa14_without_offset()) is None


def test_arms_without_offsets_are_found(arms):
    """Shoulder and wrist are where the model has them."""
    assert [SRS.refusal(robot) for robot in arms] == [None] * len(arms)
    srs = SRS.of(arms[0])
    np.testing.assert_allclose(
        [srs.shoulder, srs.elbow, srs.wrist], [[0, 0, z] for z in (0.438, 1.138, 1.838)], atol=1e-15
    )
    np.testing.assert_allclose(srs.reach, (0, 1.4), atol=1e-15)


@pytest.mark.parametrize(("offset", "refused"), [(1e-11, False), (1e-7, True)])
@pytest.mark.parametrize("joint", ["joint1", "joint3", "joint5", "joint7"])
def test_offsets_count_from_the_tolerance_on(joint, offset, refused):
    """An axis that is moved by less than 1e-9 of the arm's length is taken to meet the others, and else not."""
    pin.seed(2)
    robot = random_arm(np.random.default_rng(2), **{joint: offset * np.array([1.0, -2.0, 0.5])})
    assert (SRS.of(robot) is None) == refused


def test_what_is_no_spherical_joint_is_refused():
    """Parallel neighbours, an elbow's axis through the shoulder, and a prismatic joint are named."""

    def arm(change: dict[int, dict]) -> mq.Robot:
        rows = [
            {"d": d, "alpha": a, "lower": -1.0, "upper": 1.0} for d, a in zip((1, 0, 1, 0, 1, 0, 1), ALPHA, strict=True)
        ]
        for i, fields in change.items():
            rows[i] |= fields
        return mq.Robot.from_dh(rows)

    assert SRS.refusal(arm({})) is None
    assert "parallel" in str(SRS.refusal(arm({0: {"alpha": 0.0}, 1: {"alpha": 0.0}})))
    assert "revolute" in str(SRS.refusal(arm({3: {"kind": "prismatic"}})))
    assert "on the axis of the elbow" in str(SRS.refusal(arm({2: {"d": 0.0}})))


ALPHA = (-np.pi / 2, np.pi / 2, -np.pi / 2, np.pi / 2, -np.pi / 2, np.pi / 2, 0.0)


def test_every_configuration_reaches_the_pose(arms, rng):
    """Eight branches on arms with right angles, up to eight on others; each reaches any random pose to 1e-12."""
    for robot in arms:
        srs = SRS.of(robot)
        counts = set()
        for _ in range(60):
            T = robot.forward(rng.uniform(-4, 4, 7)).homogeneous
            found = srs.configurations(T, rng.uniform(-np.pi, np.pi))
            assert worst_error(robot, found, T) < 1e-12
            assert ((found > -np.pi) & (found <= np.pi)).all()
            counts.add(len(found))
        assert counts == {8} if robot.name != "random" else counts <= {0, 2, 4, 8}


def test_the_angles_of_a_configuration_are_found_again(arms, rng):
    """Of any q at random, one of the branches at its own swivel angle is q itself."""
    for robot in arms:
        srs = SRS.of(robot)
        for _ in range(40):
            q = rng.uniform(-np.pi, np.pi, 7)
            found = srs.configurations(robot.forward(q), swivel_of(srs, q))
            assert np.abs(wrapped(found - q)).max(axis=1).min() < 1e-9


def test_the_swivel_angle_is_that_of_the_task(maira, rng):
    """On a planar elbow psi is the angle that `SwivelTask` turns."""
    srs = SRS.of(maira)
    shoulder, elbow, wrist = (maira.moved_links[i] for i in (1, 3, 5))
    task = SwivelTask(shoulder=shoulder, elbow=elbow, wrist=wrist, angle=0.0).of(maira)
    for _ in range(20):
        T, psi = maira.forward(maira.random_configuration(rng)), rng.uniform(-np.pi, np.pi)
        for q in srs.configurations(T, psi):
            assert abs(wrapped(task.swivel(maira.at(q)) - psi)) < 1e-9


@pytest.mark.parametrize("distance", [1e-4, 1e-7, 1e-9, 1e-12, 0.0])
def test_near_singular_poses_are_reached_as_exactly(arms, rng, distance):
    """Elbow stretched, shoulder or wrist singular, or all of them, to any closeness: the residual stays below 1e-12."""
    for robot in arms[:3]:
        srs = SRS.of(robot)
        for singular in ([3], [1], [5], [1, 3, 5]):
            q = robot.random_configuration(rng)
            q[singular] = distance * rng.choice([-1, 1], len(singular))
            T = robot.forward(q).homogeneous
            for psi in (swivel_of(srs, q), rng.uniform(-np.pi, np.pi)):
                found = srs.configurations(T, psi)
                assert len(found) in (4, 8)
                assert worst_error(robot, found, T) < 1e-12


def test_stretched_and_folded_arms_have_one_elbow_and_none_beyond(iiwa14):
    """At the ends of the annulus the two elbow angles are one; a micrometre beyond there is none."""
    srs = SRS.of(iiwa14)
    for q4, outward in ((0.0, 1.0), (np.pi, -1.0)):
        q = np.array([0.3, 0.7, -0.2, q4, 0.4, 0.9, 0.1])
        T = iiwa14.forward(q).homogeneous
        line = srs.wrist_centre(T) - srs.shoulder
        line /= np.linalg.norm(line)
        assert len(srs.elbow_branches(T)) in (1, 2)
        T[:3, 3] += 1e-6 * outward * line
        assert srs.configurations(T, 0.3).shape == (0, 7)
        T[:3, 3] -= 2e-6 * outward * line
        assert len(srs.configurations(T, 0.3)) == 8


def test_three_rotations_about_any_axes(rng):
    """Both decompositions make the rotation, or it is where the axes cannot take it, in a cone around a or against."""
    reached = []
    for _ in range(300):
        axes = np.array([random_direction(rng) for _ in range(3)])
        if min(np.linalg.norm(np.cross(axes[k], axes[k + 1])) for k in (0, 1)) < PARALLEL_WITHIN:
            continue
        joint = SphericalJoint(*axes)
        R = rotations(random_direction(rng), np.array(rng.uniform(0, np.pi)))
        q = joint.decompose(R)
        made = [rotations(axes[0], a) @ rotations(axes[1], b) @ rotations(axes[2], c) for a, b, c in q]
        height = axes[0] @ R @ axes[2]
        assert np.isnan(q).any() == (abs(height - joint.constant) > joint.amplitude)
        if not np.isnan(q).any():
            np.testing.assert_allclose(made, [R, R], atol=1e-14)
        reached.append(not np.isnan(q).any())
    assert 50 < sum(reached) < 290
