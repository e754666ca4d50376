"""Hard limits in `solve`: kept by whatever comes back wherever they can be, and a nearest point is one within them.

Each limit is looked at by forward kinematics alone, without what the limits say of themselves.
"""

import pickle
from dataclasses import dataclass

import numpy as np
import pytest
from support.robots import load

import maira_qp as mq
from maira_qp.errors import OptionError
from maira_qp.problem.limits.joint import Limit

FEW = mq.Options(max_restarts=10)


@dataclass(frozen=True)
class Inside(mq.Limit):
    """The origin of a frame stays within a box; without a `violation` of its own."""

    low: tuple[float, float, float]
    high: tuple[float, float, float]
    frame: str | None = None

    def rows(self, at, tick):  # noqa: D102
        J, p = at.jacobian(self.frame)[:3], at.placement(self.frame).translation
        return np.vstack([J, -J]), np.concatenate([np.array(self.high) - p, p - np.array(self.low)])


@dataclass(frozen=True)
class MeasuredInside(Inside):
    """The same with a `violation`, as example 11 has it."""

    def violation(self, at):  # noqa: D102
        p = at.placement(self.frame).translation
        return float(max(0.0, (p - self.high).max(), (np.array(self.low) - p).max()))


@dataclass(frozen=True, kw_only=True)
class JointTask(mq.Task):
    """The joints at given values."""

    q: tuple[float, ...]

    def error(self, at):  # noqa: D102
        return np.array(self.q) - at.q

    def jacobian(self, at):  # noqa: D102
        return np.eye(at.n)


def around(p: np.ndarray, half: float, kind: type = Inside, frame: str | None = None) -> Limit:
    return kind(tuple(p - half), tuple(p + half), frame)


def outside(robot: mq.Robot, q: np.ndarray, p: np.ndarray, half: float, frame: str | None = None) -> float:
    """By how much a frame at q (n,) is out of the cube around p [m]."""
    return float((np.abs(robot.forward(q, frame).translation - p) - half).max())


def clearance(robot: mq.Robot, obstacle: mq.Sphere | mq.Box, q: np.ndarray) -> float:
    """The smallest distance [m] of the robot to an obstacle."""
    limit = mq.CollisionLimit(obstacles=[obstacle], self_collision=False, influence=5.0).of(robot)
    return limit.distance(robot.at(q))


@pytest.mark.parametrize("kind", [Inside, MeasuredInside])
@pytest.mark.parametrize("name", ["maira", "panda", "ur5_limited"])
def test_the_tool_does_not_leave_its_box_for_a_target_outside(name, kind, rng):
    """From no start, a start inside and one outside: the error is the distance of the target to the box."""
    robot = mq.Robot.maira() if name == "maira" else load(name)
    for start in ("none", "inside", "outside"):
        q = 0.5 * robot.random_configuration(rng) + 0.5 * robot.middle
        centre = robot.forward(q).translation
        target = mq.pose(centre + np.array([0.1, -0.05, 0.08]))
        q0 = {"none": None, "inside": q, "outside": robot.random_configuration(rng)}[start]
        limits = [around(centre, 0.04, kind)]
        s = mq.Solver(robot, task=mq.PositionTask(), limits=limits, options=FEW).solve(target, q0=q0)
        assert outside(robot, s.q, centre, 0.04) <= 0
        assert s.broken_limits == {}
        assert s.status in (mq.Status.NEAREST, mq.Status.UNREACHABLE)
        corner = mq.Solver(robot, task=mq.PositionTask()).solve(mq.pose(centre + np.array([0.04, -0.04, 0.04])))
        if corner.success:
            assert s.position_error == pytest.approx(np.linalg.norm([0.06, 0.01, 0.04]), abs=1e-7)


@pytest.mark.rounding
def test_an_arm_stays_out_of_a_ball_around_its_target(maira, rng):
    """A ball of 0.15 m where the tool is to be: clear by the margin, and a stationary point."""
    robot = maira
    for _ in range(6):
        target = robot.forward(robot.random_configuration(rng))
        ball = mq.Sphere(0.15, mq.pose(target.translation))
        s = mq.Solver(robot, limits=[mq.CollisionLimit(obstacles=[ball], self_collision=False)]).solve(target)
        if s.status is mq.Status.LIMITS_BROKEN:  # a ball around the base
            random = [robot.random_configuration(rng) for _ in range(200)]
            assert max(clearance(robot, ball, q) for q in random) < 0.01
            continue
        assert clearance(robot, ball, s.q) >= 0.01
        assert s.status is mq.Status.NEAREST


def test_a_start_that_is_clear_is_kept_clear_whatever_the_budget(maira, rng):
    """One iteration, no restart, or no time: the answer from a start within the limits is within them."""
    for options in (
        mq.Options(max_iterations=1, max_restarts=0),
        mq.Options(max_restarts=0),
        mq.Options(deadline=1e-9),
    ):
        q = maira.random_configuration(rng)
        target = maira.forward(maira.random_configuration(rng))
        centre = maira.forward(q).translation
        solver = mq.Solver(maira, limits=[around(centre, 0.05)], options=options)
        for s in (solver.solve(target, q0=q), solver.solve_batch([target], q0=q)[0]):
            assert outside(maira, s.q, centre, 0.05) <= 0
            assert s.status is not mq.Status.LIMITS_BROKEN


def test_three_boxes_that_can_be_kept_together_are(maira, rng):
    """For a posture outside of them, from anywhere."""
    for _ in range(2):
        q = maira.random_configuration(rng)
        frames = ("link4", "link5", None)
        centres = [maira.forward(q, frame or maira.tip).translation for frame in frames]
        limits = [around(p, 0.05, frame=frame) for p, frame in zip(centres, frames, strict=True)]
        solver = mq.Solver(maira, task=JointTask(q=tuple(maira.middle)), limits=limits, options=FEW)
        for q0 in (None, maira.random_configuration(rng)):
            s = solver.solve(q0=q0)
            assert (
                max(outside(maira, s.q, p, 0.05, frame or maira.tip) for p, frame in zip(centres, frames, strict=True))
                <= 0
            )
            assert s.status is mq.Status.NEAREST


@pytest.mark.parametrize(
    "redundancy", [mq.Strict(mq.Posture()), mq.Weighted(mq.Posture(), 1e-2)], ids=["strict", "weighted"]
)
def test_the_redundancy_is_settled_within_the_limits(maira, rng, redundancy):
    """The elbow below a ceiling that the posture would raise it through."""
    for _ in range(3):
        q = 0.5 * maira.random_configuration(rng)
        target, p = maira.forward(q), maira.forward(q, "link4").translation
        s = mq.Solver(maira, redundancy=redundancy, limits=[around(p, 0.03, frame="link4")]).solve(target, q0=q)
        assert outside(maira, s.q, p, 0.03, "link4") <= 0
        assert s.optimal


@pytest.mark.rounding
def test_limits_that_exclude_each_other_are_named_with_what_is_broken(maira):
    """Two boxes 0.1 m apart along x: the least sum of squares breaks each by half of that."""
    p = np.array([0.5, 0.1, 0.6])
    solver = mq.Solver(maira, limits=[around(p, 0.05), around(p + np.array([0.2, 0, 0]), 0.05)], options=FEW)
    target = mq.pose(p, quaternion=[0, 1, 0, 0])
    s = solver.solve(target)
    assert s.status is mq.Status.LIMITS_BROKEN
    assert not s.success
    assert not s.optimal
    assert s.broken_limits == {
        "Inside 1 row 1": pytest.approx(0.05, abs=1e-3),
        "Inside 2 row 4": pytest.approx(0.05, abs=1e-3),
    }
    assert maira.forward(s.q).translation[0] == pytest.approx(0.6, abs=1e-3)
    assert "keeps the limits beside those of the joints" in str(s.explain())
    assert all(f"{one.name} by 0.05" in str(s.explain()) for one in s.explain().broken)
    batch = solver.solve_batch([target])
    assert batch.status.tolist() == [mq.Status.LIMITS_BROKEN]
    assert batch.broken_limits == [s.broken_limits]
    assert pickle.loads(pickle.dumps(s)).broken_limits == s.broken_limits == s.as_dict()["broken_limits"]
    assert "further limits" in s.status.meaning


def test_bodies_that_overlap_everywhere_are_named_with_the_metres_that_are_missing(maira):
    """A ball that holds the first moving link."""
    ball = mq.Sphere(0.6, mq.pose([0, 0, 0.4]), name="ball")
    s = mq.Solver(maira, limits=[mq.CollisionLimit(obstacles=[ball], self_collision=False)], options=FEW).solve(
        mq.pose([0.9, 0, 0.9])
    )
    assert s.status is mq.Status.LIMITS_BROKEN
    assert any(name.endswith(" - ball") for name in s.broken_limits)
    assert list(s.broken_limits.values()) == sorted(s.broken_limits.values(), reverse=True)
    assert f"{next(iter(s.broken_limits))} by " in str(s.explain())
    assert s.explain().hints == ()  # which are about links


def test_links_that_overlap_by_design_are_to_be_allowed_to():
    """Where shapes of links touch in the middle of all ranges too, the explanation says how to let them."""
    wide = '<link name="{}"><collision><geometry><sphere radius="0.5"/></geometry></collision></link>'
    links = wide.format("a") + '<link name="b"/>' + wide.format("c")
    joint = (
        '<joint name="{0}{1}" type="revolute"><parent link="{0}"/><child link="{1}"/><origin xyz="0 0 0.3"/>'
        '<axis xyz="1 0 0"/><limit lower="-1" upper="1"/></joint>'
    )
    robot = mq.Robot.from_urdf(f'<robot name="r">{links}{joint.format("a", "b")}{joint.format("b", "c")}</robot>')
    s = mq.Solver(robot, task=mq.PositionTask(), limits=[mq.CollisionLimit()], options=FEW).solve(mq.pose([0, 0, 0.6]))
    assert s.status is mq.Status.LIMITS_BROKEN
    assert "a - c touch in the middle of all joint ranges too" in str(s.explain())
    for allowed in ("sampled", [("a", "c")]):
        assert f"allowed={allowed}" in str(s.explain()).replace('"', "")
        letting = mq.Solver(robot, task=mq.PositionTask(), limits=[mq.CollisionLimit(allowed=allowed)], options=FEW)
        assert letting.solve(mq.pose([0, 0, 0.6])).success
    assert s.explain().broken[0].unit == "m"


def test_linear_limits_that_leave_nothing_are_refused_beside_others(maira):
    """At construction, also where a limit that is not linear stands beside them."""
    row = np.eye(maira.n)[1:2]
    exclusive = mq.LinearLimit(np.vstack([row, -row]), [-0.5, -0.5])
    for others in ([], [around(np.zeros(3), 1.0)]):
        with pytest.raises(OptionError, match="no configuration satisfies the limits together"):
            mq.Solver(maira, limits=[exclusive, *others])


def test_coupled_joints_and_an_obstacle_are_kept_together(maira, rng):
    """A linear limit on two joints beside a ball at the target."""
    A = np.zeros((1, maira.n))
    A[0, 1:3] = 1.0
    for _ in range(3):
        target = maira.forward(maira.random_configuration(rng))
        target.translation[:] = [0.7, 0.2, 0.5]
        ball = mq.Sphere(0.1, mq.pose(target.translation))
        limits = [mq.LinearLimit(A, [0.3]), mq.CollisionLimit(obstacles=[ball])]
        s = mq.Solver(maira, limits=limits, options=FEW).solve(target)
        assert (A @ s.q <= 0.3 + 1e-9).all()
        assert clearance(maira, ball, s.q) >= 0.01
        assert s.status is mq.Status.NEAREST
        assert s.broken_limits == {}


def test_rows_bend_by_their_second_derivative(maira, rng):
    """Of an own limit and of pairs of bodies: the change of the weighted rows along a step."""
    at = maira.at(0.5 * maira.random_configuration(rng))
    ball = mq.Sphere(0.1, mq.pose(at.placement().translation + np.array([0.2, 0.1, 0.0])))
    for limit in (around(np.zeros(3), 0.1), mq.CollisionLimit(obstacles=[ball], self_collision=False).of(maira)):
        h = limit.rows(at, None)[1]
        y, step = rng.uniform(0, 1, len(h)), 1e-4 * rng.normal(size=maira.n)
        C = limit.curvature(at, y)
        change = y @ (limit.rows(at.moved(step), None)[0] - limit.rows(at.moved(-step), None)[0])
        np.testing.assert_allclose(C, C.T, atol=1e-12)
        np.testing.assert_allclose(2 * C @ step, change, atol=1e-2 * np.abs(change).max())
