"""Limits that a caller sets: what holds afterwards, everywhere it is said, and what is refused."""

import copy
import pickle
from math import inf, nan, pi
from xml.etree import ElementTree

import numpy as np
import pytest
from support.made_robots import random_table
from support.robots import REAL_ROBOTS, load

import maira_qp as mq
from maira_qp.errors import OptionError, RobotError
from maira_qp.robots.dh.table import DHLink

KEYS = ("lower", "upper", "velocity_limit", "effort_limit", "acceleration_limit")

HAND = """<robot name="hand" version="1.2"><link name="a"/><link name="b"/><link name="c"/><link name="d"/>
  <joint name="turn" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/></joint>
  <joint name="lead" type="revolute"><parent link="b"/><child link="c"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="2" velocity="3" effort="4" acceleration="5" deceleration="8" jerk="100"/></joint>
  <joint name="follow" type="prismatic"><parent link="c"/><child link="d"/><axis xyz="1 0 0"/>
    <limit lower="-1" upper="3" velocity="9" effort="4" acceleration="7"/><mimic joint="lead" multiplier="2"/></joint>
</robot>"""


@pytest.fixture
def hand():
    return mq.Robot.from_urdf(HAND)


def limits(robot):
    return {key: getattr(robot, key) for key in KEYS}


def assert_consistent(robot):
    """Model, text, DH table, ranges to draw from, copies: all say the same limits."""
    assert (robot.model.lowerPositionLimit == robot.lower).all()
    assert (robot.model.upperPositionLimit == robot.upper).all()
    assert (robot.model.velocityLimit == robot.velocity_limit).all()
    others = [copy.copy(robot), copy.deepcopy(robot), pickle.loads(pickle.dumps(robot)), robot.limited()]
    others.append(mq.Robot.from_urdf(robot.urdf, tip=robot.tips, base=robot.base))
    others += [] if robot.dh is None else [mq.Robot.from_dh(robot.dh)]
    for other in others:
        assert other == robot
        assert hash(other) == hash(robot)
        for key, values in limits(robot).items():
            assert (getattr(other, key) == values).all()
            assert not getattr(other, key).flags.writeable
    if robot.dh is not None:
        assert (robot.dh.lower == robot.lower).all()
        assert (robot.dh.upper == robot.upper).all()
        rows = [link for link in robot.dh.links if link.kind != "fixed"]
        assert [link.velocity for link in rows] == robot.velocity_limit.tolist()
        assert [link.acceleration or inf for link in rows] == robot.acceleration_limit.tolist()
    drawn = np.array([robot.random_configuration(np.random.default_rng(k)) for k in range(30)])
    assert ((robot.lower <= drawn) & (drawn <= robot.upper)).all()


@pytest.mark.parametrize("name", ["maira", "panda", "pr2_arm", "tiago_arms", "panda_finger", "pr2_fingers", "random"])
def test_limits_that_are_set_hold_everywhere_and_nothing_else_changes(name, rng):
    """Real arms and trees, continuous, prismatic and mimic joints, DH tables."""
    if name == "random":
        robot = mq.Robot.from_dh(random_table(rng, 8))
    else:
        robot = mq.Robot.maira() if name == "maira" else load(name)
    span = robot.drawn_range[1] - robot.drawn_range[0]
    lower, upper = robot.drawn_range[0] + 0.2 * span, robot.drawn_range[1] - 0.1 * span
    velocity = np.minimum(robot.velocity_limit, 3) * 0.7
    acceleration = rng.uniform(1, 5, robot.n)
    made = robot.limited(lower=lower, upper=upper, velocity=velocity, acceleration=acceleration, margin=0.01 * span)
    assert (made.lower == lower + 0.01 * span).all()
    assert (made.upper == upper - 0.01 * span).all()
    assert (made.velocity_limit == velocity).all()
    assert (made.acceleration_limit == acceleration).all()
    assert (made.effort_limit == robot.effort_limit).all()
    assert_consistent(made)
    assert made != robot
    assert (made.joint_names, made.tips, made.base, made.frames) == (
        *(robot.joint_names, robot.tips, robot.base, robot.frames),
    )
    q = made.random_configuration(rng)
    for tip in robot.tips:
        assert (made.forward(q, tip).homogeneous == robot.forward(q, tip).homogeneous).all()


@pytest.mark.parametrize("name", REAL_ROBOTS)
def test_no_limits_change_nothing(name):
    robot = load(name)
    assert robot.limited() == robot
    assert robot.limited(lower=robot.lower, upper=robot.upper, velocity=robot.velocity_limit, margin=0) == robot


def test_numbers_are_for_all_joints_arrays_for_each_and_names_for_some(maira):
    assert (maira.limited(velocity=1).velocity_limit == 1).all()
    assert (maira.limited(velocity=np.float32(1)).velocity_limit == 1).all()
    assert (maira.limited(velocity=np.array(1)).velocity_limit == 1).all()
    assert maira.limited(acceleration=range(1, 8)).acceleration_limit.tolist() == [1, 2, 3, 4, 5, 6, 7]
    some = maira.limited(lower={"joint2": -1}, velocity={"joint7": 0.5, "joint1": 1}, margin={"joint4": 0.25})
    assert some.lower.tolist() == [-pi, -1, -pi, maira.lower[3] + 0.25, -pi, -pi, -pi]
    assert some.upper.tolist() == [*maira.upper[:3], maira.upper[3] - 0.25, *maira.upper[4:]]
    assert some.velocity_limit.tolist() == [1, pi, pi, pi, pi, pi, 0.5]
    assert some.acceleration_limit.tolist() == [inf] * 7
    assert maira.limited(lower={}, margin={}) == maira


def test_the_margin_comes_off_the_limits_that_are_set(maira):
    made = maira.limited(lower=-1, upper={"joint1": 0.5}, margin=0.125)
    assert made.lower.tolist() == [-0.875] * 7
    assert made.upper.tolist() == [0.375, *(maira.upper[1:] - 0.125)]


def test_a_margin_does_not_end_what_turns_without_end(pr2_arm, hand):
    turns = np.isinf(pr2_arm.upper)
    made = pr2_arm.limited(margin=0.05)
    assert np.isinf(made.upper[turns]).all()
    assert (made.upper[~turns] == pr2_arm.upper[~turns] - 0.05).all()
    assert hand.limited(margin=0.05).lower[0] == -inf


def test_a_continuous_joint_that_gets_both_ends_is_revolute(hand):
    made = hand.limited(lower={"turn": -7}, upper={"turn": 8}, margin={"turn": 1})
    assert (made.lower[0], made.upper[0]) == (-6, 7)
    assert_consistent(made)
    with pytest.raises(OptionError, match=r"joint 'turn': limits of -7.0 and inf: give both, or neither"):
        hand.limited(lower={"turn": -7})
    with pytest.raises(OptionError, match=r"joint 'turn': .* give both, or neither"):
        hand.limited(upper=1)
    table = mq.Robot.from_dh([{"kind": "continuous", "a": 1}, {"a": 1}])
    made = table.limited(lower=-1, upper=1)
    assert made.dh.links[0].kind == "revolute"
    assert_consistent(made)


def test_a_joint_may_be_locked(maira):
    made = maira.limited(lower={"joint3": 0.5}, upper={"joint3": 0.5})
    assert made.lower[2] == made.upper[2] == 0.5
    assert_consistent(made)


def test_limits_are_set_on_leaders_and_their_followers_keep_within_their_own(hand):
    """lead: within -1 <= 2 q <= 3 of its follower; its speed and acceleration are half of its follower's at most."""
    assert hand.joint_names == ("turn", "lead")
    assert (hand.lower[1], hand.upper[1], hand.velocity_limit[1], hand.acceleration_limit[1]) == (-0.5, 1.5, 3, 3.5)
    made = hand.limited(upper={"lead": 1.25}, velocity={"lead": 2}, acceleration={"lead": 6})
    assert (made.lower[1], made.upper[1], made.velocity_limit[1], made.acceleration_limit[1]) == (-0.5, 1.25, 2, 6)
    assert_consistent(made)
    with pytest.raises(OptionError, match="'follow' is not a joint that moves on its own; valid names: turn, lead"):
        hand.limited(velocity={"follow": 1})


def test_accelerations_are_free_to_set_and_to_lift(maira, hand):
    fast = hand.limited(acceleration=20)
    assert (fast.acceleration_limit == 20).all()
    lifted = fast.limited(acceleration={"lead": inf})
    assert lifted.acceleration_limit.tolist() == [20, inf]
    assert_consistent(lifted)
    assert maira.limited(acceleration=3).limited(acceleration=inf) == maira


def test_limits_set_twice_are_those_of_both(maira):
    once = maira.limited(lower={"joint1": -1}, velocity={"joint2": 2}, acceleration={"joint3": 9})
    assert once.limited(upper={"joint1": 1}) == maira.limited(
        lower={"joint1": -1}, upper={"joint1": 1}, velocity={"joint2": 2}, acceleration={"joint3": 9}
    )
    with pytest.raises(OptionError, match=r"joint 'joint1': the lower limit -2.0 would loosen that of -1.0"):
        once.limited(lower={"joint1": -2})


@pytest.mark.parametrize(
    ("wish", "message"),
    [
        ({"lower": {"joint2": -3}}, r"joint 'joint2': the lower limit -3.0 would loosen that of -2\.09"),
        ({"lower": -inf}, "joint 'joint1': the lower limit -inf would loosen"),
        ({"upper": 2.5}, r"joint 'joint2': the upper limit 2.5 would loosen that of 2\.09"),
        ({"velocity": 4}, r"joint 'joint1': the velocity limit 4.0 would loosen that of 3\.14"),
        ({"velocity": {"joint5": inf}}, "joint 'joint5': the velocity limit inf would loosen"),
        ({"velocity": {"joint5": 0}}, "joint 'joint5': the velocity limit must be positive, got 0.0"),
        ({"velocity": -1}, "joint 'joint1': the velocity limit must be positive, got -1.0"),
        ({"acceleration": {"joint6": 0}}, "joint 'joint6': the acceleration limit must be positive, got 0.0"),
        ({"acceleration": [1, 2, -3, 4, 5, 6, 7]}, "joint 'joint3': the acceleration limit must be positive"),
        ({"margin": -0.1}, "joint 'joint1': the margin must be finite and not negative, got -0.1"),
        ({"margin": {"joint4": inf}}, "joint 'joint4': the margin must be finite and not negative, got inf"),
        ({"margin": 2.5}, r"joint 'joint2': the margin 2\.5 .* the largest that is valid is 2\.09439"),
        ({"margin": {"joint4": 9}}, r"joint 'joint4': the margin 9\.0 .* the largest that is valid is"),
        ({"margin": 2, "upper": {"joint3": 0}}, r"'joint3': the margin 2\.0 .* of -3\.14\d* to 0\.0; .* is 1\.5707"),
        ({"lower": 1, "upper": {"joint7": 0.5}}, r"joint 'joint7': the limits 1.0 > 0.5 are inverted"),
        ({"lower": {"joint4": 3}}, "joint 'joint4': the limits 3.0 > .* are inverted"),
        ({"lower": {"joint4": inf}}, "joint 'joint4': the limits inf > .* are inverted"),
        ({"upper": {"joint4": -inf}}, "joint 'joint4': the limits .* > -inf are inverted"),
        ({"lower": {"joint_3": 0}}, "lower: 'joint_3' is not a joint .*; did you mean 'joint3'. valid names: joint1, "),
        ({"margin": {3: 0}}, "margin: 3 is not a joint"),
        ({"lower": nan}, "lower must not be NaN"),
        ({"upper": {"joint1": nan}}, "upper of joint 'joint1' must not be NaN"),
        ({"velocity": [1] * 6 + [nan]}, "velocity must not be NaN"),
        ({"acceleration": nan}, "acceleration must not be NaN"),
        ({"margin": nan}, "margin must not be NaN"),
        ({"velocity": [1, 2]}, r"velocity must be real numbers of shape \(7,\), not list of shape \(2,\)"),
        ({"velocity": [[1] * 7]}, r"of shape \(7,\), not list of shape \(1, 7\)"),
        ({"velocity": {"joint1": [1]}}, r"velocity of joint 'joint1' must be a real number, not list"),
        ({"velocity": "1"}, "velocity must be a real number, not str: '1'"),
        ({"velocity": True}, "velocity must be a real number, not bool: True"),
        ({"velocity": {"joint1": None}}, "velocity of joint 'joint1' must be a real number, not NoneType"),
        ({"velocity": object()}, "velocity must be real numbers .* not object: <object object at"),
    ],
)
def test_limits_that_would_loosen_or_make_no_sense_are_refused(maira, wish, message):
    with pytest.raises(OptionError, match=message):
        maira.limited(**wish)


@pytest.mark.parametrize("joint", ["joint1", "joint3", "joint4"])
def test_the_largest_margin_that_a_message_names_is_taken(maira, joint):
    """One that leaves a single angle, and none beyond it."""
    ends = {"lower": {joint: -1.1}, "upper": {joint: 0.3}}
    with pytest.raises(OptionError, match=f"{joint}.* the largest that is valid is") as told:
        maira.limited(margin=3.0, **ends)
    largest = float(str(told.value).rsplit(" ", 1)[1])
    taken, i = maira.limited(margin=largest, **ends), maira.joint_names.index(joint)
    assert taken.upper[i] - taken.lower[i] < 1e-12
    with pytest.raises(OptionError, match=joint):
        maira.limited(margin=largest + 1e-12, **ends)


def test_limits_too_wide_to_have_a_size_are_refused(hand):
    with pytest.raises(OptionError, match=r"joint 'turn': .* give both, or neither"):
        hand.limited(lower={"turn": -1e308}, upper={"turn": 1e308})


# Accelerations in descriptions


def with_limit(attributes):
    return (
        '<robot name="r"><link name="a"/><link name="b"/><joint name="j" type="revolute"><parent link="a"/>'
        f'<child link="b"/><limit lower="-1" upper="1" {attributes}/></joint></robot>'
    )


@pytest.mark.parametrize(
    ("attributes", "expected"),
    [
        ("", inf),
        ('acceleration="0"', inf),
        ('acceleration="inf"', inf),
        ('acceleration="2.5"', 2.5),
        ('deceleration="2"', 2),
        ('acceleration="4" deceleration="2"', 2),
        ('acceleration="1e-3" deceleration="0"', 1e-3),
    ],
)
def test_the_acceleration_of_a_urdf_is_the_smaller_of_speeding_up_and_slowing_down(attributes, expected, capfd):
    robot = mq.Robot.from_urdf(with_limit(attributes))
    assert robot.acceleration_limit.tolist() == [expected]
    assert_consistent(robot)
    limit = next(ElementTree.fromstring(robot.urdf).iter("limit"))
    assert ("acceleration" in limit.attrib) == (expected < inf)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("attributes", "message"),
    [
        ('acceleration="-1"', "joint 'j', limit: acceleration='-1' is negative"),
        ('deceleration="-inf"', "deceleration='-inf' is negative"),
        ('acceleration="nan"', "acceleration='nan' is not finite"),
        ('acceleration="fast"', "is not made of numbers"),
        ('acceleration="1 2"', "should be 1 number"),
    ],
)
def test_accelerations_that_are_no_limit_are_refused(attributes, message):
    with pytest.raises(RobotError, match=message):
        mq.Robot.from_urdf(with_limit(attributes))


def test_the_acceleration_of_a_dh_row():
    robot = mq.Robot.from_dh([DHLink(a=1, acceleration=2.5), DHLink(kind="fixed", a=1), {"a": 1.0}])
    assert robot.acceleration_limit.tolist() == [2.5, inf]
    assert_consistent(robot)
    for wrong in (0, -1, nan, inf, "2", True):
        with pytest.raises(RobotError, match="link 1: acceleration limit must be a positive number, got"):
            mq.Robot.from_dh([{"acceleration": wrong}])


def test_solvers_keep_the_limits_that_are_set(maira, rng):
    """A pose that the tighter arm can reach is reached within the tighter limits."""
    tight = maira.limited(margin=0.5)
    target = tight.forward(tight.random_configuration(rng))
    s = mq.Solver(tight).solve(target)
    assert s.success
    assert ((tight.lower <= s.q) & (s.q <= tight.upper)).all()


def test_a_leader_that_is_released_takes_its_follower_along():
    """The follower's own range had narrowed the leader's: both are let go, and the limits that hold stay."""
    joint = '<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/><axis xyz="0 0 1"/>{3}</joint>'
    limit = '<limit lower="-1" upper="{}" velocity="1" effort="1"/>'
    text = "".join(
        [
            '<robot name="m"><link name="a"/><link name="b"/><link name="c"/>',
            joint.format("leader", "a", "b", limit.format(1.5)),
            joint.format(
                "follower", "b", "c", limit.format(0.6) + '<mimic joint="leader" multiplier="-2" offset="0.1"/>'
            ),
            "</robot>",
        ]
    )
    robot = mq.Robot.from_urdf(text, tip="c")
    assert (robot.lower[0], robot.upper[0]) == pytest.approx((-0.25, 0.55))
    free = robot.released(["leader upper"])
    assert free.upper[0] == pytest.approx(0.55 + 2 * np.pi)
    assert free.lower[0] == robot.lower[0]
    tighter = robot.limited(upper=0.3)
    assert (tighter.lower[0], tighter.upper[0]) == (robot.lower[0], 0.3)
    again = free.released(["leader lower"])
    assert (again.lower[0], again.upper[0]) == pytest.approx((-0.25 - 2 * np.pi, 0.55 + 2 * np.pi))


def test_limits_of_a_dh_table_are_given_at_load():
    """In place of those of the table, looser ones too; the rest of it stays."""
    links = [{"kind": "fixed", "d": 0.1}, {"kind": "continuous", "a": 0.5}, {"a": 0.4, "lower": -1.0, "upper": 1.0}]
    robot = mq.Robot.from_dh(links, limits={"joint2": (-2.0, 3.0)})
    assert robot.lower.tolist() == [-np.inf, -2.0]
    assert robot.upper.tolist() == [np.inf, 3.0]
    both = mq.Robot.from_dh(robot.dh, limits={"joint1": (-4.0, 4.0)})
    assert both.upper.tolist() == [4.0, 3.0]
    assert both.dh.links[1].kind == "revolute"
    assert mq.Robot.from_urdf(both.urdf) == both
    assert mq.Robot.from_dh(robot.dh, limits={}) == robot
    with pytest.raises(OptionError, match=r"limits: 'joint3' is not a joint.*valid names: joint1, joint2"):
        mq.Robot.from_dh(links, limits={"joint3": (-1.0, 1.0)})
