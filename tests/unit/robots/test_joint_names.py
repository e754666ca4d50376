"""Joint values by name: mappings in, mappings out, and the order of somebody else's list."""

import pickle

import numpy as np
import pytest
from support.robots import load

import maira_qp as mq
from maira_qp.errors import ConfigurationError, OptionError

ROBOTS = ("panda", "ur5", "talos_arms", "pr2_arms", "panda_finger")
"""An arm of 7 and of 6, two dual arms with their torsos, and a gripper with a mimic joint."""


def by_name(robot, q, rng=None):
    """A mapping of all joints, in some order."""
    pairs = list(zip(robot.joint_names, q.tolist(), strict=True))
    return dict(pairs if rng is None else [pairs[k] for k in rng.permutation(len(pairs))])


@pytest.mark.parametrize("name", ROBOTS)
def test_a_mapping_in_any_order_is_the_configuration(name, rng):
    robot = load(name)
    for _ in range(5):
        q, dq = robot.random_configuration(rng), robot.random_configuration(rng)
        named = by_name(robot, q, rng)
        frame = str(rng.choice(robot.frames))
        np.testing.assert_array_equal(robot.configuration(named), q)
        np.testing.assert_array_equal(robot.forward(named, frame).homogeneous, robot.forward(q, frame).homogeneous)
        np.testing.assert_array_equal(robot.jacobian(named, frame), robot.jacobian(q, frame))
        assert robot.condition_number(named) == robot.condition_number(q)
        assert robot.manipulability(named) == robot.manipulability(q)
        np.testing.assert_array_equal(robot.integrate(named, by_name(robot, dq, rng)), q + dq)
        np.testing.assert_array_equal(robot.difference(named, by_name(robot, dq, rng)), dq - q)
        assert robot.joints(q) == by_name(robot, q)


@pytest.mark.parametrize("name", ROBOTS)
def test_order_sorts_the_values_of_a_joint_state(name, rng):
    """Alphabetical, with joints of a hand between them, as ROS publishes them."""
    robot = load(name)
    q = robot.random_configuration(rng)
    state = by_name(robot, q) | {"a_finger": 7.0, "zz_wheel": 8.0, "m_head": 9.0}
    names = sorted(state)
    position = np.array([state[each] for each in names])
    np.testing.assert_array_equal(position[robot.order(names)], q)
    np.testing.assert_array_equal(position[robot.order(np.array(names))], q)


def test_order_names_what_is_missing_and_what_there_is(panda):
    names = [*panda.joint_names[1:], "panda_joint_1"]
    with pytest.raises(OptionError, match=r"^the names lack 'panda_joint7'; given: panda_joint1, .*, panda_joint6$"):
        panda.order(panda.joint_names[:-1])
    with pytest.raises(OptionError, match=r"lack 'panda_joint1'; did you mean 'panda_joint_1'\? given: panda_joint2, "):
        panda.order(names)
    with pytest.raises(OptionError, match=r"lack 'panda_joint1', .*, 'panda_joint7'; given: none$"):
        panda.order([])
    with pytest.raises(OptionError, match=r"lack 'panda_joint1', .*; given: 1, .* \(60 more\)$"):
        panda.order([str(k) for k in range(1, 101)])
    with pytest.raises(OptionError, match="'panda_joint2' is named twice"):
        panda.order([*panda.joint_names, "panda_joint2"])
    assert len(panda.order([*panda.joint_names, "other", "other"])) == 7
    with pytest.raises(OptionError, match="must be a list"):
        panda.order("panda_joint1")


def test_a_name_that_no_joint_has_is_answered_with_those_that_there_are(panda):
    q = by_name(panda, panda.middle)
    with pytest.raises(ConfigurationError, match=r"q: 'panda_jiont1' is not a joint.*did you mean 'panda_joint1'"):
        panda.forward({**q, "panda_jiont1": 0.0})
    del q["panda_joint3"]
    for call in (panda.forward, panda.jacobian, panda.configuration, panda.manipulability):
        with pytest.raises(ConfigurationError, match="a value for each joint, and 'panda_joint3' is missing"):
            call(q)
    with pytest.raises(ConfigurationError, match="q of joint 'panda_joint3'"):
        panda.forward({**q, "panda_joint3": "high"})
    with pytest.raises(ConfigurationError, match="finite"):
        panda.forward({**q, "panda_joint3": np.nan})


def test_a_follower_is_not_a_joint_to_be_given():
    robot = load("panda_finger")
    (follower,) = set(robot.model.names[1:]) - set(robot.joint_names)
    with pytest.raises(ConfigurationError, match="not a joint that moves on its own"):
        robot.configuration({**robot.joints(robot.middle), follower: 0.01})


def test_what_a_mapping_leaves_out_comes_from_the_default(panda, rng):
    default = panda.random_configuration(rng)
    q = panda.configuration({"panda_joint2": 0.25}, default)
    np.testing.assert_array_equal(np.delete(q, 1), np.delete(default, 1))
    assert q[1] == 0.25
    np.testing.assert_array_equal(panda.configuration({}, default), default)
    assert panda.clip({"panda_joint4": 9.0, "panda_joint1": 0.5}) == {
        "panda_joint4": panda.upper[3],
        "panda_joint1": 0.5,
    }


def test_a_posture_of_some_joints_leaves_the_others_alone(panda, rng):
    posture = mq.Posture({"panda_joint2": 0.3, "panda_joint6": 1.0}, weights={"panda_joint6": 5.0}).of(panda)
    at = panda.at(panda.random_configuration(rng))
    expected = 0.5 * (at.q[1] - 0.3) ** 2 + 2.5 * (at.q[5] - 1.0) ** 2
    assert posture.cost(at) == pytest.approx(expected)
    assert np.flatnonzero(posture.gradient(at)).tolist() == [1, 5]
    with pytest.raises(OptionError, match="q_ref of Posture: 'elbow'"):
        mq.Posture({"elbow": 0.3}).of(panda)
    with pytest.raises(OptionError, match="weights of Posture must not be negative"):
        mq.Posture(weights={"panda_joint1": -1.0}).of(panda)


def test_starts_by_name(maira, rng):
    """Joints that are not named are at the posture, or in the middle."""
    solver, named = mq.Solver(maira), {"joint2": 0.4, "joint4": 1.1}
    q0 = maira.configuration(named, maira.middle)
    target = maira.forward(maira.random_configuration(rng))
    np.testing.assert_array_equal(solver.solve(target, named).q, solver.solve(target, q0).q)
    rest = maira.random_configuration(rng)
    strict = mq.Solver(maira, redundancy=mq.Strict(mq.Posture(rest)))
    q0 = maira.configuration(named, rest)
    np.testing.assert_array_equal(strict.solve(target, named).q, strict.solve(target, q0).q)
    np.testing.assert_array_equal(
        strict.solve(target, named, prefer="closest", metric={"joint1": 3.0}).q,
        strict.solve(target, q0, prefer="closest", metric=[3, 1, 1, 1, 1, 1, 1]).q,
    )
    with pytest.raises(ConfigurationError, match="q0: 'joint8' is not a joint"):
        solver.solve(target, {"joint8": 0.0})


def test_starts_by_name_in_a_batch(maira, rng):
    solver = mq.Solver(maira)
    targets = np.array([maira.forward(maira.random_configuration(rng)).homogeneous for _ in range(3)])
    values = rng.uniform(-1, 1, 3)
    starts = np.tile(maira.middle, (3, 1))
    starts[:, 1], starts[:, 3] = 0.4, values
    expected = solver.solve_batch(targets, starts)
    columns = solver.solve_batch(targets, {"joint2": 0.4, "joint4": values})
    rows = solver.solve_batch(targets, [{"joint2": 0.4, "joint4": value} for value in values])
    np.testing.assert_array_equal(columns.q, expected.q)
    np.testing.assert_array_equal(rows.q, expected.q)
    with pytest.raises(ConfigurationError, match="q0 of joint 'joint4'"):
        solver.solve_batch(targets, {"joint4": [0.1, 0.2]})
    with pytest.raises(ConfigurationError, match="q0 1: 'joint9'"):
        solver.solve_batch(targets, [{}, {"joint9": 0.0}, {}])
    for name, column in expected.joints.items():
        np.testing.assert_array_equal(column, expected.q[:, maira.joint_names.index(name)])
    assert expected[1].joints == by_name(maira, expected.q[1])


def test_a_tick_by_name(maira, rng):
    robot = maira.limited(acceleration=10.0)
    solver, q = mq.Solver(robot), robot.random_configuration(rng)
    v = rng.uniform(-0.1, 0.1, 7)
    target = robot.forward(q + 0.01)
    expected = solver.step(q, target, 0.01, velocity=v)
    t = solver.step(by_name(robot, q, rng), target, 0.01, velocity=by_name(robot, v, rng))
    np.testing.assert_array_equal(t.q, expected.q)
    assert t.backend == expected.backend == "compiled"
    assert t.joints == by_name(robot, t.q)
    tracker = mq.Tracker(solver, by_name(robot, q, rng), velocity={"joint1": 0.5})
    np.testing.assert_array_equal(tracker.update(None, dt=0.01, measured=by_name(robot, q)).q, q)
    with pytest.raises(ConfigurationError, match="q needs a value for each joint"):
        solver.step({"joint1": 0.0}, target, 0.01, velocity=v)


def test_a_path_by_name(maira, rng):
    q = maira.configuration({"joint2": 0.5, "joint4": 1.2, "joint6": 0.8}, maira.middle)
    path = mq.paths.line(maira.forward(q), maira.forward(q + 0.02), step=0.01)
    solver = mq.Solver(maira)
    named = solver.track(path, {"joint2": 0.5, "joint4": 1.2, "joint6": 0.8}, max_step={"joint1": 0.3})
    plain = solver.track(path, q, max_step=[0.3, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5])
    np.testing.assert_array_equal(named.q, plain.q)
    assert named.joints["joint2"].shape == (len(path),)


def test_answers_by_name_survive_a_pickle(maira):
    s = mq.Solver(maira).solve(maira.forward(maira.middle + 0.1))
    assert pickle.loads(pickle.dumps(s)).joints == s.joints == by_name(maira, s.q)


@pytest.mark.parametrize("name", ROBOTS)
def test_the_derivative_of_the_jacobian_is_its_difference(name, rng):
    robot, step = load(name), 1e-6
    for frame in (None, *rng.choice(robot.frames, 2)):
        q = robot.random_configuration(rng)
        derivative = robot.jacobian_derivative(robot.joints(q), frame)
        assert derivative.shape == (robot.n, 6, robot.n)
        for i, dq in enumerate(step * np.eye(robot.n)):
            difference = (robot.jacobian(q + dq, frame) - robot.jacobian(q - dq, frame)) / (2 * step)
            np.testing.assert_allclose(derivative[i], difference, rtol=0, atol=1e-8)
