"""Why a solve ended as it did: against targets whose obstacle is known, and against solving again with limits moved."""

import pickle

import numpy as np
import pinocchio as pin
import pytest
from support.robots import load

import maira_qp as mq
from maira_qp.errors import OptionError


def beyond(robot: mq.Robot, rng: np.random.Generator, joint: int, by: float) -> tuple[mq.Robot, np.ndarray]:
    """The robot with a limit of one joint moved in front of a random configuration, and that configuration (n,)."""
    q = robot.clip(0.6 * robot.random_configuration(rng))
    upper = robot.upper.copy()
    upper[joint] = q[joint] - by
    return robot.limited(lower=np.minimum(robot.lower, upper), upper=upper), q


@pytest.mark.parametrize("name", ["ur5_limited", "irb140", "kr210", "puma560"])
def test_the_joint_that_is_in_the_way_is_named_with_how_far_it_would_have_to_go(name, rng):
    """Arms of six joints whose third cannot go where the target needs it, solved from next to it."""
    robot = load(name)
    for _ in range(5):
        short, q = beyond(robot, rng, 2, by=0.02)
        s = mq.Solver(short, options=mq.Options(max_restarts=0)).solve(robot.forward(q), q0=short.clip(q))
        assert not s.success
        why = s.explain()
        limit = f"{robot.joint_names[2]} upper"
        assert limit in why.blocking
        (found,) = [each for each in why.limits if each.name == limit]
        assert found.further == pytest.approx(0.02, abs=1e-6)
        assert found.multiplier > 0
        assert found.position == pytest.approx(s.position_error, abs=1e-6)
        assert why.is_reached_without
        assert f"{robot.joint_names[2]} 1.15 degrees beyond its upper limit" in str(why)
        for share, success in ((1.01, True), (0.9, False)):  # the limit moved so far
            upper = short.upper.copy()
            upper[2] += share * found.further
            moved = robot.limited(lower=np.minimum(robot.lower, upper), upper=upper)
            again = mq.Solver(moved, options=mq.Options(max_restarts=0)).solve(robot.forward(q), q0=s.q)
            assert again.success == success


def test_a_multiplier_is_what_the_cost_falls_by_when_the_limit_gives_way(rng):
    """By differences: the cost `1/2 |W e|^2` at the nearest point, with the limit moved by 1e-4 rad."""
    robot = load("irb140")
    for _ in range(5):
        short, q = beyond(robot, rng, 1, by=0.1)
        costs, options = [], mq.Options(max_restarts=0, stationarity_tolerance=1e-9)
        for step in (0.0, 1e-4):
            upper = short.upper.copy()
            upper[1] += step
            moved = robot.limited(lower=np.minimum(robot.lower, upper), upper=upper)
            solver = mq.Solver(moved, options=options)
            s = solver.solve(robot.forward(q), q0=moved.clip(q))
            weights = solver.tasks[0].weights
            e = mq.pose_error(robot.forward(s.q).homogeneous, robot.forward(q).homogeneous)
            costs.append(0.5 * np.sum((weights * e) ** 2))
            if step == 0.0 and s.optimal:
                (first,) = [limit.multiplier for limit in s.explain().limits if limit.name.endswith("2 upper")]
        assert (costs[0] - costs[1]) / 1e-4 == pytest.approx(first, rel=2e-2)


def test_what_is_blocked_is_told_in_the_axes_of_the_tool():
    """A gantry whose rails end 30 mm short: along its own axes, whatever its joints are called."""
    slide, half = {"kind": "prismatic", "lower": 0, "upper": 1}, np.pi / 2
    turns = [{"theta": 0, "alpha": half}, {"theta": half, "alpha": half}, {"theta": 0, "alpha": 0}]
    robot = mq.Robot.from_dh([mq.DHLink(**slide, **turn) for turn in turns])
    target = robot.forward([0.5, 0.5, 1.0])
    target.translation += 0.03 * target.rotation[:, 2]
    s = mq.Solver(robot).solve(target)
    why = s.explain()
    assert why.blocking == ("joint3 upper",)
    assert why.blocked == pytest.approx([0, 0, 0.03, 0, 0, 0], abs=1e-6)
    assert why.limits[0].unit == "m"
    assert "joint3 upper blocks 30 mm along tool z." in str(why)
    assert "With joint3 30 mm beyond its upper limit" in str(why)


def test_a_target_beyond_the_arm_itself_blames_no_limit(maira):
    why = mq.Solver(maira).solve(mq.pose([0, 0, 2.2])).explain()
    assert why.status is mq.Status.UNREACHABLE
    assert why.blocking == ()
    assert not why.is_reached_without
    assert "proved to be out of reach" in str(why)
    assert "No joint limit holds it back" in str(why)


def test_two_limits_that_block_together_are_told_together(rng):
    """Neither limit alone is to blame: only without both is the target reached."""
    robot = load("irb140")
    q = robot.clip(0.5 * robot.random_configuration(rng))
    upper = robot.upper.copy()
    upper[1:3] = q[1:3] - 0.05
    short = robot.limited(lower=np.minimum(robot.lower, upper), upper=upper)
    s = mq.Solver(short, options=mq.Options(max_restarts=0)).solve(robot.forward(q), q0=short.clip(q))
    why = s.explain()
    assert set(why.blocking) == {f"{robot.joint_names[i]} upper" for i in (1, 2)}
    assert all(limit.further is None for limit in why.limits)
    assert why.is_reached_without
    assert "Without these limits the target would be reached." in str(why)


def test_a_compromise_is_called_one(maira):
    s = mq.Solver(maira, redundancy=mq.Weighted(mq.Posture(), 1e-2)).solve(mq.pose([0.4, 0.2, 0.9]))
    why = s.explain()
    assert why.is_compromise
    assert "the weight of the posture holds the tool" in str(why)


def test_limits_of_a_settled_posture_cost_what_the_objective_would_gain(maira, rng):
    """A posture beyond a limit: its multiplier by differences of the objective at moved limits."""
    q_ref, narrow = np.full(7, 0.5), maira.limited(upper={"joint2": 0.3})
    found = 0
    for _ in range(12):
        target = narrow.forward(narrow.random_configuration(rng))
        costs = []
        for upper in (0.3, 0.3 + 1e-4):
            robot = maira.limited(upper={"joint2": upper})
            s = mq.Solver(robot, redundancy=mq.Strict(mq.Posture(q_ref))).solve(target, q0=narrow.middle)
            costs.append(s.cost)
            if upper == 0.3:
                first = s
        limit = [each for each in first.explain().limits if each.name == "joint2 upper"]
        if first.optimal and limit and limit[0].multiplier > 1e-2 and abs(costs[0] - costs[1]) < 1e-2:
            assert (costs[0] - costs[1]) / 1e-4 == pytest.approx(limit[0].multiplier, rel=2e-2)
            found += 1
    assert found > 0


def test_what_was_reached_and_what_was_pickled(maira, rng):
    s = mq.Solver(maira).solve(maira.forward(maira.random_configuration(rng)))
    assert str(s.explain()) == "The target is reached."
    assert s.proof is None
    batch = mq.Solver(maira).solve_batch([mq.pose([3, 0, 0])])
    assert batch[0].proof is not None
    assert "out of reach" in str(batch[0].explain())
    with pytest.raises(OptionError, match="pickled"):
        pickle.loads(pickle.dumps(s)).explain()


def test_tasks_that_are_no_pose_are_explained_too(maira):
    s = mq.Solver(maira, task=mq.LookAtTask(point=[0, 0, 5.0], axis=[0, 0, 1])).solve()
    assert "reached" in str(s.explain())
    far = mq.Solver(maira, tasks=[mq.PositionTask(frame="link4")], backend="daqp").solve(
        {"tool0": mq.pose([0.5, 0, 0.5]), "link4": mq.pose([2, 0, 0])}
    )
    assert not far.success
    assert "away" in str(far.explain())


@pytest.mark.rounding
def test_the_pair_that_is_in_the_way_is_named_with_what_it_costs(maira, rng):
    """A ball where the tool is to be: its pair, its distance, and by differences what a smaller margin gains."""
    T = mq.pose([0.6, 0.0, 0.5], quaternion=[0, 1, 0, 0])
    ball = mq.Sphere(0.08, mq.pose([0.6, 0.02, 0.45]), name="ball")
    near = maira.clip(mq.Solver(maira).solve(mq.pose([0.6, 0.4, 0.5], quaternion=[0, 1, 0, 0])).q)
    answers = []
    for margin in (0.02, 0.0199):
        limit = mq.CollisionLimit(obstacles=[ball], margin=margin, self_collision=False)
        options = mq.Options(max_restarts=0)
        answers.append(mq.Solver(maira, limits=[limit], options=options).solve(T, q0=near))
    s, nearer = answers
    assert s.status is mq.Status.NEAREST
    why = s.explain()
    assert [pair.name for pair in why.pairs] == [name for name in s.active_limits if "ball" in name]
    costly = [pair for pair in why.pairs if pair.multiplier > 0]
    assert costly
    assert all(pair.distance == pytest.approx(0.02, abs=1e-6) for pair in costly)
    weights = mq.Solver(maira).tasks[0].weights
    cost = [0.5 * np.sum((weights * mq.pose_error(maira.forward(one.q), T)) ** 2) for one in (s, nearer)]
    assert sum(pair.multiplier for pair in costly) == pytest.approx((cost[0] - cost[1]) / 1e-4, rel=0.05)
    assert why.is_reached_without
    assert np.linalg.norm(why.blocked) > 0.01
    assert f"{costly[0].name} are 20 mm apart." in str(why)
    assert "Without these limits the target would be reached." in str(why)
    assert costly[0].name in why.blocking
    assert why.as_dict()["pairs"][0]["multiplier"] == costly[0].multiplier


NOT_EITHER = "not reached either, from"


def cut(robot: mq.Robot, share: float) -> mq.Robot:
    """The robot with so much of each range, around its middle."""
    lower, upper = robot.drawn_range
    half = 0.5 * share * (upper - lower)
    return robot.limited(lower=robot.middle - half, upper=robot.middle + half)


@pytest.mark.parametrize("name", ["ur5", "irb140"])
def test_what_is_said_of_a_target_without_its_limits_holds(name, rng):
    """Ranges cut to 35 %: where the limits are not to blame, no solver reaches the target without them either."""
    robot = load(name)
    short, said = cut(robot, 0.35), 0
    solver = mq.Solver(short)
    for _ in range(14):
        target = robot.forward(robot.random_configuration(rng))
        s = solver.solve(target)
        if s.success:
            continue
        why, text = s.explain(), str(s.explain())
        free = mq.Solver(short.released(why.blocking))
        reached = any(free.solve(target, rng=seed).success for seed in (1, 2))
        assert why.is_reached_without == reached
        assert why.starts_without >= 1
        assert (NOT_EITHER in text) == (not reached and not why.is_unreachable_without)
        if NOT_EITHER in text:
            assert f"from any of {mq.Options().max_restarts + 1} starts" in text
            said += 1
        for limit in why.limits:
            assert limit.further is None or mq.Solver(short.released([limit.name])).solve(target, rng=3).success
    assert said < 10


def test_what_is_proved_without_limits_is_said_to_be(maira):
    """A limit that holds something up, and a target that is too far for the arm itself."""
    short = maira.limited(upper={"joint4": -0.5})
    s = mq.Solver(short).solve(mq.pose([0.0, 0.3, 2.6]))
    why = s.explain()
    assert why.blocking
    assert why.is_unreachable_without
    assert not why.is_reached_without
    assert "It is proved that without these limits it would not be reached either." in str(why)


def test_a_target_within_the_limits_that_was_missed_is_said_to_be_there(rng):
    """One start alone, from far away."""
    robot = load("irb140")
    solver, missed = mq.Solver(robot, options=mq.Options(max_restarts=0)), 0
    for _ in range(20):
        target = robot.forward(robot.random_configuration(rng))
        s = solver.solve(target, q0=robot.random_configuration(rng))
        if not s.success:
            why = s.explain()
            missed += why.is_reached_within
            assert ("From another start the target is reached within the limits." in str(why)) == why.is_reached_within
    assert missed > 3


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_what_limits_and_bodies_cost_side_by_side_is_told_apart(side):
    """A ball on slides runs into a limit in x and into another ball in y: each holds its part of the force."""
    slide = (
        '<joint name="{0}" type="prismatic"><parent link="{1}"/><child link="{2}"/><axis xyz="{3}"/>'
        '<limit lower="-1" upper="1" velocity="1" effort="1"/></joint>'
    )
    text = (
        f'<robot name="m"><link name="a"/><link name="b"/>{slide.format("x", "a", "b", "1 0 0")}'
        f'{slide.format("y", "b", "c", "0 1 0")}<link name="c"><collision><geometry><sphere radius="0.1"/></geometry>'
        "</collision></link></robot>"
    )
    robot = mq.Robot.from_urdf(text, tip="c")
    ball = mq.Sphere(0.1, mq.pose([side, 0.7 * side, 0.0]), name="ball")
    limit = mq.CollisionLimit(obstacles=[ball], margin=0.02, self_collision=False)
    solver = mq.Solver(robot, task=mq.PositionTask(), limits=[limit], options=mq.Options(max_restarts=0))
    s = solver.solve(mq.pose([1.5 * side, 0.6 * side, 0.0]), q0=[side, 0.2 * side])
    np.testing.assert_allclose(s.q, [side, 0.48 * side], atol=1e-5)
    why, weight = s.explain(), solver.tasks[0].weights[0]
    (one,), (pair,) = why.limits, why.pairs
    assert one.name == ("x upper" if side > 0 else "x lower")
    assert one.multiplier == pytest.approx(0.5 * weight**2, rel=1e-3)
    assert pair.multiplier == pytest.approx(0.12 * weight**2, rel=1e-3)


HOME = np.array([0.0, -0.3, 0.0, -2.2, 0.0, 2.0, 0.79])
"""A configuration of the Panda, far from its joint limits."""

FREE = np.inf


def in_the_way(kind: str, robot: mq.Robot, wider: float) -> tuple[mq.Limit, np.ndarray, str, str]:
    """A limit about `HOME`, `wider` [m or rad], a way (6,) that leads out of it, and its active row's name and unit."""
    T, aside, tilted = robot.forward(HOME), np.array([0, 0.05, 0, 0, 0, 0]), np.array([0, 0, 0, 0, 0.5, 0])
    p, angle = T.translation, np.radians(10) + wider
    if kind == "cone":
        return mq.ConeLimit(direction=T.rotation[:, 2], angle=angle), tilted, "ConeLimit", "rad"
    if kind == "cone of the call":
        return mq.ConeLimit(name="cup", angle=angle), tilted, "cup", "rad"
    if kind == "plane":
        return mq.HalfSpaceLimit(normal=[0, -1, 0], point=p + np.array([0, wider, 0])), aside, "HalfSpaceLimit", "m"
    if kind == "box":
        return mq.BoxLimit(upper=[FREE, p[1] + 0.01 + wider, FREE]), aside, "BoxLimit y upper", "m"
    if kind == "range":
        ranges = mq.PoseRange(target=T, axes="base", about="x", orientation=[FREE, angle, FREE])
        return ranges, tilted, "PoseRange about y upper", "rad"
    if kind == "distance":
        return mq.DistanceLimit(point=p - [0, 0.2, 0], upper=0.21 + wider), aside, "DistanceLimit upper", "m"
    lift = np.eye(7)[3]
    stretch = np.array([0.15, 0, 0.1, 0, 0, 0])
    return mq.LinearLimit([lift, -lift], [HOME[3] + 0.01 + wider, 9.0]), stretch, "LinearLimit row 1", ""


ROWS = ["cone", "cone of the call", "plane", "box", "range", "distance", "linear"]


@pytest.mark.parametrize("kind", ROWS)
def test_a_limit_beside_those_of_the_joints_is_named_with_what_it_costs(kind):
    """The only thing in the way: its multiplier is what the cost falls by where it is 1e-4 wider, by differences."""
    robot, costs, step = load("panda"), [], 1e-4
    here, start = robot.forward(HOME), HOME
    for wider in (step, 0.0):
        limit, way, name, unit = in_the_way(kind, robot, wider)
        target = pin.SE3(pin.exp3(way[3:]) @ here.rotation, here.translation + way[:3])
        solver = mq.Solver(robot, limits=[limit], options=mq.Options(max_restarts=0, stationarity_tolerance=1e-8))
        s = solver.solve({"panda_hand_tcp": target, "cup": here} if "call" in kind else target, q0=start)
        assert s.status is mq.Status.NEAREST
        costs.append(0.5 * np.sum((solver.tasks[0].weights * mq.pose_error(robot.forward(s.q), target)) ** 2))
        start = s.q
    why = s.explain()
    assert s.active_limits == [name]
    assert [(row.name, row.unit) for row in why.rows] == [(name, unit)]
    assert why.rows[0].multiplier == pytest.approx((costs[1] - costs[0]) / step, rel=2e-2)
    assert why.blocking == (name,)
    assert why.is_reached_without
    assert np.linalg.norm(why.blocked) > 0.02
    assert f"{name} blocks " in str(why)
    assert "Without these limits the target would be reached." in str(why)
    assert "holds it back" not in str(why)
    assert why.as_dict()["rows"][0]["multiplier"] == why.rows[0].multiplier
    assert str(pickle.loads(pickle.dumps(why))) == str(why)


@pytest.mark.parametrize("kind", ROWS)
def test_a_limit_that_the_answer_does_not_stand_on_is_no_reason(kind):
    """A target out of reach, past a limit that is wide."""
    robot = load("panda")
    limit, here = in_the_way(kind, robot, 2.9)[0], robot.forward(HOME)
    target = pin.SE3(here.rotation, here.translation + np.array([0, 0, 3.0]))
    solver = mq.Solver(robot, limits=[limit], options=mq.Options(max_restarts=0))
    s = solver.solve({"panda_hand_tcp": target, "cup": here} if "call" in kind else target, q0=HOME)
    why = s.explain()
    assert not s.success
    assert why.rows == ()


def test_a_joint_limit_and_a_row_share_what_they_hold_up():
    """A gantry whose target is past the end of x, and past a row that couples x and y: the force is that of both."""
    slide = {"kind": "prismatic", "lower": 0, "upper": 1}
    half = np.pi / 2
    turns = [{"theta": 0, "alpha": half}, {"theta": half, "alpha": half}, {"theta": 0, "alpha": 0}]
    robot = mq.Robot.from_dh([mq.DHLink(**slide, **turn) for turn in turns])
    solver = mq.Solver(robot, task=mq.PositionTask(), limits=[mq.LinearLimit([[1.0, 1.0, 0.0]], [1.5])])
    s = solver.solve(robot.forward([1.7, 0.9, 0.5]))
    np.testing.assert_allclose(s.q, [1.0, 0.5, 0.5], atol=1e-6)
    why, weight = s.explain(), solver.tasks[0].weights[0] ** 2
    ends = {one.name: one.multiplier for one in (*why.limits, *why.rows)}
    assert ends == {
        "joint1 upper": pytest.approx(0.3 * weight, rel=1e-3),
        "LinearLimit": pytest.approx(0.4 * weight, rel=1e-3),
    }


def test_a_reached_target_on_a_row_says_that_it_stands_on_it():
    """With nothing to hold up."""
    robot = load("panda")
    row = np.eye(7)[3]
    s = mq.Solver(robot, limits=[mq.LinearLimit([row, -row], [HOME[3], 9.0])]).solve(robot.forward(HOME), q0=HOME)
    assert s.success
    assert s.active_limits == ["LinearLimit row 1"]
    assert [each.multiplier for each in s.explain().rows] == [0.0]
    assert str(s.explain()) == "The target is reached. It stands on LinearLimit row 1."
