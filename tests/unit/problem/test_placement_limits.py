"""Ranges, cones, half-spaces, boxes and distances: their rows and curvatures by differences, and what they mean."""

import pickle

import numpy as np
import pytest
from support.derivatives import assert_close, difference_jacobian
from support.placement_limits import limits_about, outside, tilt_and_yaw, turn
from support.robots import load

import maira_qp as mq
from maira_qp.errors import FrameError, OptionError, PoseError
from maira_qp.problem.limits.joint import Tick

Z = np.array([0.0, 0.0, 1.0])


def robot_of(name: str) -> mq.Robot:
    if name == "slides":
        slide = {"kind": "prismatic", "lower": -0.3, "upper": 0.5}
        links = [mq.DHLink(alpha=-1.5, **slide), mq.DHLink(a=0.3, alpha=1.0), mq.DHLink(a=0.2, **slide)]
        return mq.Robot.from_dh([*links, mq.DHLink(a=0.2, alpha=0.7), mq.DHLink(d=0.3, alpha=-1.2), mq.DHLink(a=0.1)])
    return mq.Robot.maira() if name == "maira" else load(name)


@pytest.mark.parametrize("name", ["maira", "slides", "baxter_arms", "pr2_fingers", "panda_finger"])
def test_rows_and_curvatures_are_derivatives(name, rng):
    """Chains, prismatic joints, a tree, and joints that mimic others; with offsets, and axes of either kind."""
    robot = robot_of(name)
    for trial in range(6):
        T, frame = robot.forward(robot.random_configuration(rng), robot.tips[0]), robot.tips[trial % len(robot.tips)]
        offset = [None, [0.1, 0.2, -0.3], mq.pose([0.1, 0.0, 0.2], rpy=[1.0, 2.0, 0.3])][trial % 3]
        how = {"about": "xyz"[trial % 3], "axes": ["target", "base"][trial % 2], "offset": offset}
        limits = [
            *limits_about(T, frame).values(),
            mq.PoseRange(frame=frame, target=T, position=0.1, orientation=[0.1, 0.2, 0.3], **how),
            mq.ConeLimit(frame=frame, axis=[1.0, 2.0, 0.0], target=T, angle=0.5, offset=offset),
            mq.DistanceLimit(frame=frame, target=T, upper=0.4, offset=offset),
        ]
        at = robot.at(robot.random_configuration(rng))
        for limit in [each.of(robot) for each in limits]:
            G, h = limit.rows(at, None)
            assert len(h) == len(limit.labels) > 0
            assert_close(-G, difference_jacobian(lambda q: limit.rows(robot.at(q), None)[1], at.q), 2e-7)  # noqa: B023
            y = rng.uniform(0, 1, len(h))
            C = limit.curvature(at, y)
            pull = difference_jacobian(lambda q: y @ limit.rows(robot.at(q), None)[0], at.q)  # noqa: B023
            assert_close(C, 0.5 * (pull + pull.T), 2e-6)
            assert limit.violation(at) == pytest.approx(max(0.0, -h.min()))
            assert max(limit.residual(at)) <= np.linalg.norm(limit.violations(at)) + 1e-15


def test_derivatives_hold_near_a_tilt_of_none(maira, rng):
    """Where the tilt's formulas are 0 / 0."""
    q = maira.random_configuration(rng)
    T = maira.forward(q)
    limit = mq.PoseRange(target=T, orientation=[0.1, 0.2, 0.3]).of(maira)
    for size in (0.0, 1e-12, 1e-7, 1e-4, 1e-3, 9.9e-3, 0.0101, 0.1):
        at = maira.at(q + size * rng.normal(size=7))
        G, h = limit.rows(at, None)
        assert np.isfinite(G).all()
        assert_close(-G, difference_jacobian(lambda q: limit.rows(maira.at(q), None)[1], at.q, 1e-5), 1e-7)
        y = rng.uniform(0, 1, len(h))
        pull = difference_jacobian(lambda q: y @ limit.rows(maira.at(q), None)[0], at.q, 1e-5)  # noqa: B023
        assert_close(limit.curvature(at, y), 0.5 * (pull + pull.T), 1e-6)


def test_violations_are_those_that_the_words_mean(maira, rng):
    """Each kind by NumPy, at random poses inside and outside."""
    within = 0
    for spread in (0.02, 0.1, 1.0):
        for _ in range(20):
            q = maira.random_configuration(rng)
            T, at = maira.forward(q), maira.at(q + spread * rng.normal(size=7))
            for kind, limit in limits_about(T, maira.tip).items():
                expected = outside(kind, T, at.placement())
                bound = limit.of(maira)
                assert bound.violation(at) == pytest.approx(max(0.0, expected), abs=1e-12)
                assert bool(bound.broken(at, "")) == (expected > 1e-9)
                within += expected <= 0
    assert within > 50


def test_a_yaw_is_a_turn_about_the_z_of_the_target_whatever_the_tilt(maira, rng):
    """The rotation from the target is the turn about z, then the tilt."""
    T, ends = mq.pose([0, 0, 0], rpy=[0.3, -1.0, 2.0]), np.array([0.2, 0.3, np.pi / 6])
    limit = mq.PoseRange(target=T, orientation=ends)
    for _ in range(200):
        tilt, yaw = rng.uniform(-1.2, 1.2, 2), rng.uniform(-3.1, 3.1)
        Q = turn(np.array([*tilt, 0.0])) @ turn(yaw * Z)
        assert np.allclose(tilt_and_yaw(Q)[0], tilt)
        from_lower_ends = limit.room(mq.pose(matrix=T.rotation @ Q))
        assert np.allclose(from_lower_ends[:3] - ends, [*tilt, yaw], atol=1e-12)
    for vector in np.eye(3):  # about one axis all three are the rotation vector
        from_lower_ends = limit.room(mq.pose(matrix=T.rotation @ turn(0.7 * vector)))
        assert np.allclose(from_lower_ends[:3] - ends, 0.7 * vector, atol=1e-12)


@pytest.mark.parametrize("axes", ["target", "base"])
def test_ranges_are_measured_in_the_axes_that_are_named(axes):
    """A turn and a step along x of the target, or of the base."""
    T = mq.pose([0.4, 0.1, 0.3], rpy=[0.2, 0.5, 1.0])
    E = T.rotation if axes == "target" else np.eye(3)
    for about, axis in zip("xyz", np.eye(3), strict=True):
        limit = mq.PoseRange(target=T, position=1.0, orientation=[1.0, 1.0, 1.0], axes=axes, about=about)
        moved = mq.pose(T.translation + E @ (0.3 * axis), matrix=turn(E @ (0.3 * axis)) @ T.rotation)
        h = limit.room(moved)
        room = dict(zip(limit.labels, h, strict=True))
        assert room[f"{about} upper"] == pytest.approx(0.7)
        assert room[f"{about} lower"] == pytest.approx(1.3)
        assert room[f"about {about} upper"] == pytest.approx(0.7)
        assert room[f"about {about} lower"] == pytest.approx(1.3)


def test_ends_may_be_open_and_ranges_may_cross_half_a_turn():
    """Rows of finite ends alone; a one-sided turn ends at half a turn; 170 to 190 degrees hold one of -175."""
    open_ends = ([-np.inf, -np.inf, 0.0], [np.inf, np.inf, 0.02])
    assert mq.PoseRange(target=mq.pose(), position=open_ends).labels == ("z lower", "z upper")
    sided = mq.PoseRange(target=mq.pose(), orientation=([-np.inf] * 3, [np.inf, 0.1, 0.2]))
    assert sided.labels == ("about z lower", "about y upper", "about z upper")
    assert sided.room(mq.pose(rpy=[0, 0, -3.0])) == pytest.approx([np.pi - 3.0, 0.1, 3.2])
    across = mq.PoseRange(target=mq.pose(), orientation=([-np.inf, -np.inf, 2.967], [np.inf, np.inf, 3.316]))
    assert (across.room(mq.pose(rpy=[0, 0, -3.05])) > 0).all()
    assert across.room(mq.pose(rpy=[0, 0, -2.9])).min() == pytest.approx(3.316 - (2 * np.pi - 2.9))
    free = mq.PoseRange(target=mq.pose(), orientation=[0.1, 0.1, np.pi])
    assert free.labels == ("about x lower", "about y lower", "about x upper", "about y upper")


def test_ranges_of_no_width_are_as_exact_as_a_pose_that_is_reached():
    """1e-6 to either side."""
    limit = mq.PoseRange(target=mq.pose(), position=[0, 0.1, 0.1], orientation=[0, 0.1, 0.1])
    h = dict(zip(limit.labels, limit.room(mq.pose()), strict=True))
    assert h["x lower"] == h["x upper"] == h["about x lower"] == h["about x upper"] == 1e-6


def test_an_approach_slows_where_joints_must_brake(maira):
    """A tick may use up a share of the room, of which no more is used where the acceleration is free."""
    robot = maira.limited(acceleration=2.0)
    limit = mq.HalfSpaceLimit(point=-10.0)
    tick, at = Tick(0.01, np.zeros(7)), robot.at(robot.middle)
    room = limit.of(robot).rows(at, None)[1]
    gain = (2.0 / robot.velocity_limit).min()
    assert limit.of(robot).rows(at, tick)[1] == pytest.approx(room * 0.01 * gain / (1 + 0.01 * gain))
    assert (limit.of(maira).rows(maira.at(maira.middle), tick)[1] == room).all()


@pytest.mark.parametrize(
    ("make", "error", "words"),
    [
        (lambda: mq.PoseRange(), OptionError, "needs a range"),
        (lambda: mq.PoseRange(position=[0.1, 0.2]), OptionError, "half-width"),
        (lambda: mq.PoseRange(position=-0.1), OptionError, "must not be negative"),
        (lambda: mq.PoseRange(position=([0, 0, 1], [1, 1, 0])), OptionError, "lower end"),
        (lambda: mq.PoseRange(position=np.nan), OptionError, "NaN"),
        (lambda: mq.PoseRange(position=1, axes="tool"), OptionError, "valid names: target, base"),
        (lambda: mq.PoseRange(position=1, about="w"), OptionError, "valid names: x, y, z"),
        (lambda: mq.PoseRange(position=1, target=np.eye(3)), PoseError, "target of a PoseRange"),
        (lambda: mq.PoseRange(position=1, frame="nowhere").of(mq.Robot.maira()), FrameError, "nowhere"),
        (lambda: mq.ConeLimit(angle=0.0), OptionError, "angle"),
        (lambda: mq.ConeLimit(direction=[0, 0, 1]), OptionError, "angle"),
        (lambda: mq.ConeLimit(direction=[0, 0, 0], angle=1), OptionError, "no direction"),
        (lambda: mq.ConeLimit(direction=[0, 0, 1], target=np.eye(4), angle=1), OptionError, "not both"),
        (lambda: mq.HalfSpaceLimit(normal="up"), OptionError, "normal"),
        (lambda: mq.HalfSpaceLimit(point=[1, 2]), OptionError, "point"),
        (lambda: mq.BoxLimit(lower=[0, 0, 1], upper=[1, 1, 0]), OptionError, "lower end"),
        (lambda: mq.BoxLimit(lower=[0, 0]), OptionError, "lower of a BoxLimit"),
        (lambda: mq.DistanceLimit(point=[0, 0, 0], lower=2, upper=1), OptionError, "lower <= upper"),
        (lambda: mq.DistanceLimit(point=[0, 0, 0], target=np.eye(4)), OptionError, "not both"),
        (lambda: mq.ToolSpeedLimit(linear=0), OptionError, "linear"),
        (lambda: mq.ToolSpeedLimit(angular="fast"), OptionError, "angular"),
        (lambda: mq.BoxLimit(offset=[1, 2]), OptionError, "offset"),
        (lambda: mq.BoxLimit(name=3), OptionError, "name"),
    ],
)
def test_what_makes_no_sense_is_refused_with_what_does(make, error, words):
    with pytest.raises(error, match=words):
        make()


def test_limits_pickle_and_name_what_they_are(maira):
    """Before and after they are made for a robot; the name is the caller's."""
    T = maira.forward(maira.middle)
    for limit in [*limits_about(T, maira.tip).values(), mq.ToolSpeedLimit(linear=0.1, offset=[0, 0, 0.1])]:
        for each in (limit, limit.of(maira)):
            again = pickle.loads(pickle.dumps(each)).of(maira)
            at = maira.at(maira.middle + 0.1)
            assert again.violation(at) == limit.of(maira).violation(at)
    box = mq.BoxLimit(lower=[0, 0, 0], upper=[1, 1, 1], pose=mq.pose([5, 5, 5]), name="cell")
    assert set(box.of(maira).broken(maira.at(maira.middle), "cell")) == {"cell x lower", "cell y lower", "cell z lower"}
