"""Limits of sums that a robot brings with it: every verb keeps them unasked, as MuJoCo's own constraints judge."""

import pickle
import re

import numpy as np
import pytest
from support.robots import load

import maira_qp as mq
from maira_qp.errors import ConfigurationError, OptionError, RobotError

mujoco = pytest.importorskip("mujoco")

HAND = """<mujoco model="hand on an arm"><compiler angle="degree"/>
  <default><joint axis="0 1 0" range="-150 150"/><default class="slide"><joint type="slide" range="-0.2 0.2"/></default>
  </default>
  <worldbody><body name="a"><joint name="turn" axis="0 0 1"/><geom size="0.01"/>
    <body name="b" pos="0 0 0.4"><joint name="shoulder"/><geom size="0.01"/>
      <body name="c" pos="0 0 0.4"><joint name="elbow"/><geom size="0.01"/>
        <body name="d" pos="0 0 0.3"><joint name="wrist"/><joint name="roll" axis="0 0 1"/><geom size="0.01"/>
          <body name="e"><joint name="differential" axis="1 0 0"/><joint name="tool" class="slide" axis="0 0 1"/>
            <geom size="0.01"/><site name="grip" pos="0 0.05 0.1"/></body></body></body></body></body></worldbody>
  <tendon>
    <fixed name="split"><joint joint="wrist" coef="0.5"/><joint joint="roll" coef="-0.5"/></fixed>
    <fixed name="belt"><joint joint="differential" coef="1"/></fixed>
    <fixed name="parallelogram" range="-1 0.8"><joint joint="shoulder" coef="1"/><joint joint="elbow" coef="1"/></fixed>
    <fixed name="slack" limited="false"><joint joint="turn" coef="1"/><joint joint="elbow" coef="1"/></fixed>
  </tendon>
  <equality><tendon tendon1="belt" tendon2="split" polycoef="0.1 1"/></equality></mujoco>"""


class HandJudge:
    """MuJoCo's own residuals of the hand, all joints of which but one are the robot's."""

    def __init__(self, text):
        self.model = mujoco.MjModel.from_xml_string(text)
        self.data = mujoco.MjData(self.model)

    def broken(self, q):
        """For a configuration of the robot the largest of all residuals and excesses."""
        *values, tool = q
        by_name = dict(zip(("turn", "shoulder", "elbow", "wrist", "roll"), values, strict=True))
        by_name |= {"differential": 0.1 + 0.5 * (by_name["wrist"] - by_name["roll"]), "tool": tool}
        for name, value in by_name.items():
            self.data.joint(name).qpos[:] = value
        mujoco.mj_forward(self.model, self.data)
        kinds = mujoco.mjtConstraint
        equal = self.data.efc_type == int(kinds.mjCNSTR_EQUALITY)
        return max(np.abs(self.data.efc_pos[equal]).max(), -self.data.efc_pos[~equal].min(initial=0.0))


@pytest.fixture(scope="module")
def hand():
    return mq.Robot.from_mjcf(HAND, tip="grip")


def test_a_hand_says_what_it_is_held_by(hand):
    assert hand.joint_names == ("turn", "shoulder", "elbow", "wrist", "roll", "tool")
    split, parallelogram = hand.sum_limits
    assert (parallelogram.name, dict(parallelogram.coefficients)) == ("parallelogram", {"shoulder": 1.0, "elbow": 1.0})
    assert (parallelogram.lower, parallelogram.upper) == (-1.0, 0.8)
    assert (split.name, split.upper) == ("differential", pytest.approx(np.radians(150) - 0.1))
    assert "limits of sums: differential, parallelogram" in str(hand)


@pytest.mark.parametrize("redundancy", [None, mq.Strict(mq.Posture())])
def test_every_verb_keeps_what_the_robot_brings(hand, rng, redundancy):
    """Whatever is asked for, MuJoCo finds no coupling and no range broken; targets within them are reached."""
    judge, few = HandJudge(HAND), mq.Options(max_restarts=10)
    solver = mq.Solver(hand, redundancy=redundancy, task=mq.PositionTask(), options=few)
    targets = [hand.forward(hand.random_configuration(rng)) for _ in range(6)]
    far = mq.pose([0.0, 0.0, 2.0])
    batch = solver.solve_batch([*targets, far])
    assert batch.success.tolist() == [True] * 6 + [False]
    answers = [solver.solve(targets[0]).q, solver.solve(far, q0=hand.middle).q, *batch.q]
    q = hand.random_configuration(rng)
    for _ in range(40):
        q = solver.step(q, far, dt=0.05).q
        answers.append(q)
    assert max(map(judge.broken, answers)) < 1e-9


def test_limits_of_sums_go_with_the_robot(hand, rng):
    """Through pickles, its URDF, tools, bases, narrower limits, objects and locked joints; a solver's come beside."""
    again = pickle.loads(pickle.dumps(hand))
    assert again == hand
    assert again.sum_limits == hand.sum_limits
    read = mq.Robot.from_urdf(hand.urdf, tip="grip")
    assert read.urdf == hand.urdf
    assert read.sum_limits == hand.sum_limits
    changed = hand.with_tool(mq.pose([0, 0, 0.1])).with_base(mq.pose([1, 0, 0]), name="room").limited(margin=0.01)
    assert changed.sum_limits == hand.sum_limits == changed.holding(mq.Sphere(0.1)).holding(None).sum_limits
    locked = changed.locked({"elbow": 0.3, "roll": 0.1})
    assert dict(locked.sum_limits[1].coefficients) == {"shoulder": 1.0}
    assert locked.sum_limits[1].upper == pytest.approx(0.5)
    assert mq.Robot.from_urdf(locked.urdf, tip=locked.tip).sum_limits == locked.sum_limits
    assert mq.Robot.from_mjcf(HAND, tip="c").locked({"elbow": 0.3, "shoulder": 0.0}).sum_limits == ()
    with pytest.raises(
        OptionError, match="locked: these values break the limit 'parallelogram' of the joints shoulder"
    ):
        hand.locked({"elbow": 0.7, "shoulder": 0.7})
    own = mq.LinearLimit([[1, 0, 0, 0, 0, 0]], [0.2])
    solver = mq.Solver(hand, limits=[own], task=mq.PositionTask())
    assert [type(limit).__name__ for limit in solver.limits[-2:]] == ["LinearLimit"] * 2
    s = solver.solve(hand.forward(hand.random_configuration(rng)))
    assert s.q[0] <= 0.2
    with pytest.raises(OptionError, match="'sum_limits' is a hard limit, which has no weight"):
        solver.solve(hand.forward(hand.middle), weights={"sum_limits": 0})


def test_joints_at_rest_count_in_sums_where_they_are_placed():
    short = mq.Robot.from_mjcf(HAND, tip="b")
    assert short.sum_limits[0].upper == 0.8
    for value in (0.5, -0.5):
        moved = short.at_rest({"elbow": value})
        assert moved.sum_limits[0].upper == pytest.approx(0.8 - value)
        assert moved.at_rest({"elbow": 0.1}).sum_limits[0].upper == pytest.approx(0.7)
        assert moved.limited(margin=0.1).sum_limits == moved.sum_limits
        assert moved != short
    assert mq.Robot.from_mjcf(HAND, tip="a").sum_limits == ()


def test_a_sum_that_nothing_keeps_is_refused_by_its_name(hand):
    text = HAND.replace('range="-1 0.8"', 'range="20 21"')
    robot = mq.Robot.from_mjcf(text, tip="grip")
    with pytest.raises(ConfigurationError, match=r"no configuration .* sums differential, parallelogram"):
        robot.random_configuration(np.random.default_rng(0))
    with pytest.raises(OptionError, match="no configuration satisfies the limits together"):
        mq.Solver(robot)


def test_flat_sums_are_drawn_from(hand, rng):
    """With equal ends, where a corner of the box is all that is left, and where no joint has any room."""

    def between(lower, upper):
        ends = f'name="parallelogram" lower="{lower!r}" upper="{upper!r}"'
        return mq.Robot.from_urdf(re.sub('name="parallelogram" lower="[^"]*" upper="[^"]*"', ends, hand.urdf), "grip")

    robot = between(0.1, 0.1)
    drawn = np.array([robot.random_configuration(rng) for _ in range(60)])
    assert np.abs(drawn[:, 1] + drawn[:, 2] - 0.1).max() < 1e-9
    assert (np.ptp(drawn, axis=0) > 0.6 * (robot.upper - robot.lower)).all()
    assert max(HandJudge(HAND).broken(q) for q in drawn) < 1e-9
    corner = hand.upper[[1, 2]]
    np.testing.assert_allclose(between(float(corner.sum()), 9.0).random_configuration(rng)[[1, 2]], corner, atol=1e-9)
    still = robot.limited(lower=np.full(6, 0.05), upper=np.full(6, 0.05))
    np.testing.assert_allclose(still.random_configuration(rng), 0.05, atol=1e-9)


def test_narrow_sums_are_drawn_from(rng):
    """Where hardly a draw from the box is within, from all of what the sums leave."""
    text = HAND.replace('range="-1 0.8"', 'range="0.1 0.1001"')
    robot = mq.Robot.from_mjcf(text, tip="grip")
    drawn = np.array([robot.random_configuration(rng) for _ in range(100)])
    sums = drawn[:, 1] + drawn[:, 2]
    assert (sums >= 0.1 - 1e-9).all()
    assert (sums <= 0.1001 + 1e-9).all()
    assert np.ptp(drawn[:, 1]) > 3
    assert (np.ptp(drawn, axis=0) > 0.6 * (robot.upper - robot.lower)).all()
    assert (drawn >= robot.lower).all()
    assert (drawn <= robot.upper).all()


def test_paths_keep_the_range_of_a_tendon(rng):
    """Of an arm without followers, judged by the lengths of MuJoCo's tendon."""
    text = HAND.split("<equality>")[0] + "</mujoco>"
    robot = mq.Robot.from_mjcf(text, tip="grip")
    assert robot.n == 7
    judge, ends = HandJudge(text), [robot.random_configuration(rng) for _ in range(2)]
    path = [robot.forward((1 - share) * ends[0] + share * ends[1]) for share in np.linspace(0, 1, 8)]
    answer = mq.Solver(robot).track(path)
    assert answer.success.all()
    for q in answer.q:
        for name, value in zip(robot.joint_names, q, strict=True):
            judge.data.joint(name).qpos[:] = value
        mujoco.mj_forward(judge.model, judge.data)
        assert -1 <= judge.data.tendon("parallelogram").length.item() <= 0.8


def test_an_explanation_names_the_tendon(hand):
    """Where it stands in the way of a pose that is reached without it."""
    q = np.array([0.1, 0.7, 0.4, 0.5, 0.3, 0.05])
    s = mq.Solver(hand, options=mq.Options(max_restarts=0)).solve(hand.forward(q), q0=q - [0, 0.2, 0.2, 0, 0, 0])
    assert not s.success
    assert s.active_limits == ["parallelogram upper"]
    assert "parallelogram upper blocks" in str(s.explain())
    assert s.explain().is_reached_without


def test_a_path_with_a_free_axis_keeps_sums():
    """One on which an arm that only knows the ranges of its joints goes elsewhere."""
    element = '<sum_limit name="split" lower="-0.5" upper="0.2"><term joint="panda_joint1"/>'
    element += '<term joint="panda_joint3" coefficient="2"/><term joint="panda_joint7" coefficient="0.5"/></sum_limit>'
    text = load("panda").urdf.replace("</robot>", f"{element}</robot>")
    robot, rng = mq.Robot.from_urdf(text, tip="panda_hand_tcp"), np.random.default_rng(1)
    ends = [robot.random_configuration(rng) for _ in range(2)]
    path = [robot.forward((1 - share) * ends[0] + share * ends[1]) for share in np.linspace(0, 1, 20)]
    answer = mq.Solver(robot, task=mq.PoseTask(orientation_weight=[1, 1, 0], axes="target")).track(path)
    assert answer.success.all()
    assert (np.abs(answer.q @ [1, 0, 2, 0, 0, 0, 0.5] + 0.15) <= 0.35 + 1e-9).all()


def test_limits_at_load_are_those_of_the_joint_that_follows_several():
    robot = mq.Robot.from_mjcf(HAND, tip="grip", limits={"differential": (-0.1, 0.3)})
    assert (robot.sum_limits[0].lower, robot.sum_limits[0].upper) == pytest.approx((-0.2, 0.2))
    with pytest.raises(OptionError, match="limits: 'nope' is not a joint that moves"):
        mq.Robot.from_mjcf(HAND, tip="grip", limits={"nope": (0, 1)})


@pytest.mark.parametrize(
    ("element", "message"),
    [
        ('<sum_limit name="s" lower="0"><term joint="nope"/><term joint="joint1"/></sum_limit>', "'s' is about 'nope'"),
        ('<sum_limit name="s" lower="1" upper="0"><term joint="joint1"/></sum_limit>', "inverted limits"),
        ('<sum_limit lower="x"><term joint="joint1"/></sum_limit>', "lower='x' is not a number"),
        ('<sum_limit lower="nan"><term joint="joint1"/></sum_limit>', "lower='nan' is not a number"),
        ('<sum_limit lower="0"><term joint="joint1" coefficient="inf"/></sum_limit>', "coefficient='inf'"),
    ],
)
def test_sums_of_a_urdf_that_make_no_sense(element, message):
    text = mq.Robot.maira().urdf.replace("</robot>", f"{element}</robot>")
    with pytest.raises(RobotError, match=message):
        mq.Robot.from_urdf(text, tip="tool0")
    assert mq.Robot.from_urdf(text, tip="tool0", base="link1").sum_limits == ()  # it concerns no joint that moves


def test_a_sum_of_a_urdf_has_one_end_or_both():
    element = '<sum_limit name="s" upper="1"><term joint="joint1"/><term joint="joint2" coefficient="-2"/></sum_limit>'
    robot = mq.Robot.from_urdf(mq.Robot.maira().urdf.replace("</robot>", f"{element}</robot>"), tip="tool0")
    (limit,) = robot.sum_limits
    assert (limit.lower, limit.upper, dict(limit.coefficients)) == (-np.inf, 1.0, {"joint1": 1.0, "joint2": -2.0})
    assert [name for name, _ in mq.Solver(robot).limits[-1].named_rows(1)] == ["s upper"]


def test_followers_and_fixed_joints_count_in_a_sum_where_they_stand(rng):
    """By the reference values of all joints: those that lead, follow, rest beside the chain, and are fixed."""
    joint = (
        '<joint name="{0}" type="{2}"><parent link="{1}"/><child link="l{0}"/><axis xyz="0 0 1"/>'
        '<limit lower="{3}" upper="2"/>{4}</joint><link name="l{0}"/>'
    )
    follows = '<mimic joint="a" multiplier="2" offset="0.1"/>'
    tree = joint.format("a", "base", "revolute", -2, "") + joint.format("b", "la", "revolute", -9, follows)
    tree += joint.format("c", "lb", "revolute", -2, "") + joint.format("rest", "base", "revolute", 0.5, "")
    tree += joint.format("fixed", "base", "fixed", 0, "")
    terms = "".join(
        f'<term joint="{name}" coefficient="{factor}" {at}/>'
        for name, factor, at in (
            ("a", 1, ""),
            ("b", 0.5, ""),
            ("c", -3, ""),
            ("rest", 2, ""),
            ("fixed", 1, 'at="0.25"'),
        )
    )
    element = f'<sum_limit name="s" lower="-1" upper="2">{terms}</sum_limit>'
    text = f'<robot name="r"><link name="base"/>{tree}{element}</robot>'
    robot = mq.Robot.from_urdf(text, tip="lc")
    assert robot.joint_names == ("a", "c")
    (limit,) = robot.sum_limits
    for _ in range(5):
        a, c = rng.uniform(-1, 1, 2)
        whole = a + 0.5 * (2 * a + 0.1) - 3 * c + 2 * 0.5 + 0.25
        part = limit.coefficients["a"] * a + limit.coefficients["c"] * c
        assert whole - part == pytest.approx(-1 - limit.lower) == pytest.approx(2 - limit.upper)
    for again in (mq.Robot.from_urdf(robot.urdf, tip="lc"), pickle.loads(pickle.dumps(robot))):
        assert again.sum_limits[0].lower == pytest.approx(limit.lower)
    placed = robot.at_rest({"rest": 1.0}).sum_limits[0]
    assert placed.lower == pytest.approx(limit.lower - 1.0)
    a_fixed = robot.locked({"a": 0.2})
    for each in (a_fixed, mq.Robot.from_urdf(a_fixed.urdf, tip="lc")):
        assert dict(each.sum_limits[0].coefficients) == {"c": -3.0}
        assert each.sum_limits[0].upper == pytest.approx(limit.upper - 0.4)
