"""Proofs that a pose is out of reach, against configurations that reach it and a check by forward kinematics alone."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation
from support.robots import load

import maira_qp as mq
from maira_qp.analytic.bounding_points import tool_points
from maira_qp.problem.problem import Problem
from maira_qp.problem.targets import pose_of, row_of
from maira_qp.results.certificate import TOO_FAR, TOO_NEAR, TURNED, BoxProof
from maira_qp.solvers.certificates import Proofs

TASKS = {"pose": mq.PoseTask(), "position": mq.PositionTask(), "orientation": mq.OrientationTask()}
ROBOTS = ["maira", "panda", "ur5", "irb140", "kr210", "puma560", "scara", "gantry"]


def proofs_of(robot: mq.Robot, task: str = "pose") -> Proofs:
    """Those by boxes, also of an S-R-S arm, for which others go before them."""
    return replace(Proofs.build(Problem.build(robot, task=TASKS[task])), srs=None)


def robot_named(name: str) -> mq.Robot:
    """An arm of the catalog or of a package, or one with sliding joints."""
    half = np.pi / 2
    slide = {"kind": "prismatic", "a": 0, "theta": 0, "d": 0, "lower": 0}
    turn = {"kind": "revolute", "a": 0, "alpha": 0, "d": 0, "theta": 0, "lower": -2.5, "upper": 2.5}
    links = {
        "scara": [turn | {"a": 0.4}, turn | {"a": 0.3, "alpha": np.pi}, slide | {"alpha": 0, "upper": 0.2}, turn],
        "gantry": [slide | {"alpha": half, "upper": 1.5}, slide | {"alpha": half, "upper": 1}, turn | {"a": 0.3}],
    }
    if name in links:
        return mq.Robot.from_dh([mq.DHLink(**link) for link in links[name]], name=name)
    return mq.Robot.maira() if name == "maira" else load(name)


def wide_poses(robot: mq.Robot, rng: np.random.Generator, count: int) -> np.ndarray:
    """Rows (N, 12) in and around the workspace."""
    poses = []
    for _ in range(count):
        q = rng.standard_normal(4)
        R = pin.Quaternion(*(q / np.linalg.norm(q))).toRotationMatrix()
        poses.append(row_of(pin.SE3(R, rng.uniform(-1.3, 1.3, 3) * robot.length)))
    return np.array(poses)


def assert_proved(robot: mq.Robot, proof: BoxProof, target: pin.SE3) -> None:
    """The boxes hold all joint values and overlap nowhere, and for each of them its test rules the target out."""
    lower, upper = robot.drawn_range
    moving = upper > lower
    assert (proof.boxes[:, 0] >= lower).all()
    assert (proof.boxes[:, 1] <= upper).all()
    share = np.prod(((proof.boxes[:, 1] - proof.boxes[:, 0]) / np.where(moving, upper - lower, 1))[:, moving], axis=1)
    assert share.sum() == pytest.approx(1, abs=1e-12)
    for i, a in enumerate(proof.boxes[:60]):
        for b in proof.boxes[:i]:
            assert not ((a[0] < b[1] - 1e-12) & (b[0] < a[1] - 1e-12))[moving].all()
    for box, (point, pivot), side in zip(proof.boxes[:200], proof.tests[:200], proof.sides, strict=False):
        far, near, turned = beyond(robot, proof, box, point, pivot, target)
        assert {TOO_FAR: far, TOO_NEAR: near, TURNED: turned}[side] > 0


def beyond(
    robot: mq.Robot, proof: BoxProof, box: np.ndarray, point: int, pivot: int, target: pin.SE3
) -> tuple[float, float, float]:
    """By how much the target is too far [m], too near [m], or turned too far [rad] for all of a box, by Pinocchio."""
    q, h = box.mean(axis=0), 0.5 * (box[1] - box[0])
    J, data = [], robot.model.createData()
    pin.computeJointJacobians(robot.model, data, q)
    pin.framesForwardKinematics(robot.model, data, q)
    for i in range(robot.n):
        column = pin.getJointJacobian(robot.model, data, i + 1, pin.LOCAL_WORLD_ALIGNED).reshape(6, -1)[:, i]
        J.append((column[:3], column[3:], data.oMi[i + 1].translation))
    slides = [np.linalg.norm(angular) < 0.5 for _, angular, _ in J]
    tool = data.oMf[robot.frame_id(None)]
    if point < 0:
        angle = np.linalg.norm(pin.log3(tool.rotation.T @ target.rotation))
        return -np.inf, -np.inf, angle - h[~np.array(slides)].sum() - 1e-6

    def moved(place: np.ndarray, joints: range) -> float:
        """How far a place may be moved by joints, the last one first."""
        total = 0.0
        for i in reversed(joints):
            _, axis, origin = J[i]
            arm = np.linalg.norm(np.cross(axis, place - origin)) + total
            total += h[i] if slides[i] else 2 * np.sin(min(h[i], np.pi) / 2) * arm
        return total

    p, t, joint = tool.act(proof.points[point]), target.act(proof.points[point]), robot.n
    o = p
    if pivot < len(proof.pivots):
        joint, along = int(proof.pivots[pivot, 0]), proof.pivots[pivot, 1]
        o = J[joint][2] + along * J[joint][1]
    linear, axis, origin = J[0]
    paths = o[None]
    if joint > 0:  # a fine sampling of the arc on which the first joint takes the pivot
        steps = np.linspace(-h[0], h[0], 2001)
        turned = Rotation.from_rotvec(steps[:, None] * axis).apply(o - origin)
        paths = o + steps[:, None] * linear if slides[0] else origin + turned
    away = np.linalg.norm(paths - t, axis=1)
    slack = moved(o, range(1, joint)) + moved(p, range(joint + 1, robot.n)) + 1e-6
    length = np.linalg.norm(p - o)
    return away.min() - slack - length, length - slack - away.max(), -np.inf


@pytest.mark.parametrize("task", TASKS)
@pytest.mark.parametrize("name", ROBOTS)
def test_no_pose_that_a_configuration_reaches_is_called_out_of_reach(name, task, rng):
    """Nor one within the tolerances of it: at random, stretched, on the limits."""
    robot = robot_named(name)
    proofs, rows = proofs_of(robot, task), []
    for k in range(60):
        q = robot.random_configuration(rng)
        if k % 3 == 1:
            q = np.where(rng.random(robot.n) < 0.7, np.where(rng.random(robot.n) < 0.5, *robot.drawn_range), q)
        if k % 3 == 2:
            q = robot.clip(np.where(rng.random(robot.n) < 0.7, 0.0, q))
        pose = robot.forward(q)
        shift, turn = (v / np.linalg.norm(v) * 0.999e-6 for v in rng.standard_normal((2, 3)))
        rows += [row_of(pose), row_of(pin.SE3(pin.exp3(turn) @ pose.rotation, pose.translation + shift))]
    assert not proofs.unreachable(np.array(rows)).any()


@pytest.mark.parametrize("name", ROBOTS)
def test_poses_that_many_starts_do_not_reach_are_mostly_proved_out_of_reach(name, rng):
    robot = robot_named(name)
    rows = wide_poses(robot, rng, 60)
    proved = proofs_of(robot).unreachable(rows)
    solved = mq.Solver(robot, options=mq.Options(max_restarts=30)).solve_batch([pose_of(row) for row in rows]).success
    assert not (proved & solved).any()
    assert proved.sum() > 0.5 * (~solved).sum()
    for row in rows[proved][:8]:
        assert_proved(robot, proofs_of(robot).proof({robot.tip: pose_of(row)}), pose_of(row))


def test_just_beyond_the_reach_of_an_arm_without_offsets_a_single_distance_tells(maira):
    """MAIRA's wrist is 1.4 m from its shoulder at most: 1e-5 m beyond is proved, and one tolerance beyond is not."""
    proofs = proofs_of(maira)
    for beyond, known in ((1e-5, True), (0.9e-6, False)):
        pose = pin.SE3(np.eye(3), np.array([0, 0, 0.438 + 1.4 + 0.115 + beyond]))
        assert proofs.unreachable(row_of(pose)[None])[0] == known
    far = proofs.proof({maira.tip: mq.pose([3.0, 0, 0])})
    assert len(far.boxes) == 1
    assert proofs.proof({maira.tip: maira.forward(np.full(7, 0.3))}) is None


def test_a_proof_says_whether_the_target_is_too_far_or_too_near():
    """In words, of an arm without a closed form: 50 m away, and beside the base where the bent elbow leaves a hole."""
    robot = robot_named("scara")
    bent = robot.limited(lower={"joint2": -0.5}, upper={"joint2": 0.5})
    for arm, x, words in ((robot, 50.0, "it is too far from joint"), (bent, 0.05, "too near to")):
        said = proofs_of(arm, "position").proof({arm.tip: mq.pose([x, 0.0, -0.1])}).words
        assert words in said
        assert ("far" in said) != ("near" in said)


def test_nothing_is_claimed_where_nothing_is_known():
    """Of trees, of frames that are not the tip, and of tasks that leave part of the position free."""
    maira = mq.Robot.maira()
    half = mq.PositionTask(position_weight=[1, 1, 0])
    elbow = mq.PositionTask(frame=maira.frames[4])
    for task in (half, elbow, mq.LookAtTask(point=[1, 0, 0])):
        assert Proofs.build(Problem.build(maira, task=task)) is None
    tree = load("baxter_arms")
    assert Proofs.build(Problem.build(tree)) is None


@pytest.mark.parametrize("name", ["panda", "xarm7"])
def test_an_offset_wrist_has_a_point_that_its_last_two_joints_hardly_move(name, rng):
    """The last not at all, the one before by less than it moves the tip."""
    robot = load(name)
    point = tool_points(robot)[1]
    for _ in range(5):
        q = robot.random_configuration(rng)
        turned = q + np.array([0.0] * (robot.n - 2) + [1.0, 1.0])
        moved = [robot.forward(each).act(point) for each in (q, turned)]
        others = [robot.forward(each).translation for each in (q, turned)]
        assert np.linalg.norm(moved[1] - moved[0]) < 0.7 * np.linalg.norm(others[1] - others[0])
        last = turned - np.array([0.0] * (robot.n - 2) + [1.0, 0.0])  # the last joint alone
        np.testing.assert_allclose(robot.forward(last).act(point), moved[0], atol=1e-12)
