"""Paths are followed without a jump where that is possible, and the result says where it is not."""

import json
import pickle
from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest
from support.robots import load

import maira_qp as mq
from maira_qp.errors import ConfigurationError, OptionError, PoseError

POSES = 120


def arm(name: str) -> mq.Robot:
    return mq.Robot.maira() if name == "maira" else load(name)


def smooth_motion(robot: mq.Robot, rng: np.random.Generator, count: int = POSES) -> np.ndarray:
    """A random smooth joint motion (count, n) within the limits: a Bezier curve of four configurations."""
    lower, upper = np.maximum(robot.lower, -np.pi), np.minimum(robot.upper, np.pi)
    a, b, c, d = rng.uniform(lower, upper, size=(4, robot.n))
    t = np.linspace(0.0, 1.0, count)[:, None]
    return (1 - t) ** 3 * a + 3 * t * (1 - t) ** 2 * b + 3 * t**2 * (1 - t) * c + t**3 * d


def poses_along(robot: mq.Robot, motion: np.ndarray) -> np.ndarray:
    return np.array([robot.forward(q).homogeneous for q in motion])


def errors(robot: mq.Robot, q: np.ndarray, targets: np.ndarray) -> np.ndarray:
    """Errors (N, 2) [m, rad] of configurations (N, n), by Pinocchio."""
    found = []
    for here, target in zip(q, targets, strict=True):
        difference = robot.forward(here).inverse() * pin.SE3(target)
        found.append([np.linalg.norm(difference.translation), np.linalg.norm(pin.log3(difference.rotation))])
    return np.array(found)


def largest_step(q: np.ndarray) -> float:
    return np.abs(np.diff(q, axis=0)).max()


@pytest.mark.parametrize("is_start_given", [False, True])
@pytest.mark.parametrize("name", ["maira", "panda", "ur5"])
def test_what_an_arm_has_done_is_followed(name, is_start_given, rng):
    """The path is that of a motion which is then forgotten: it is followed whole, with steps not much larger."""
    robot = arm(name)
    for _ in range(2):
        motion = smooth_motion(robot, rng)
        targets = poses_along(robot, motion)
        path = mq.Solver(robot).track(targets, motion[0] if is_start_given else None)
        assert path, path.reason
        assert path.reason == ""
        assert path.reconfigurations == 0
        assert (path.q >= robot.lower).all()
        assert (path.q <= robot.upper).all()
        assert (errors(robot, path.q, targets) < 1.1e-6).all()
        assert path.max_joint_step == largest_step(path.q) < min(0.5, 4 * largest_step(motion))
        if is_start_given:
            np.testing.assert_allclose(path.q[0], motion[0], atol=1e-9)


def test_between_its_poses_the_tool_stays_on_the_path(rng):
    robot = mq.Robot.maira()
    targets = poses_along(robot, smooth_motion(robot, rng))
    path = mq.Solver(robot).track(targets)
    assert path
    halfway = [
        pin.SE3.Interpolate(pin.SE3(before), pin.SE3(after), 0.5).homogeneous for before, after in pairwise(targets)
    ]
    off = errors(robot, 0.5 * (path.q[1:] + path.q[:-1]), np.array(halfway))
    assert np.median(off[:, 0]) < 1e-3
    assert np.median(off[:, 1]) < 1e-2


def two_links() -> mq.Robot:
    link = {"d": 0.0, "alpha": 0.0, "lower": -3.0, "upper": 3.0}
    return mq.Robot.from_dh([{"a": 0.5, **link}, {"a": 0.5, **link}])


@pytest.mark.parametrize("seed", range(3))
def test_an_arm_of_few_joints_follows_what_it_has_done(seed):
    """Three joints are asked for whole poses: those between the poses of its path are out of its reach."""
    robot = mq.Robot.from_dh([{"a": 0.3, "alpha": 1.0, "d": 0.1, "lower": -2.0, "upper": 2.0}] * 3)
    motion = smooth_motion(robot, np.random.default_rng(seed), 60)
    path = mq.Solver(robot).track(poses_along(robot, motion))
    assert path, path.reason
    assert largest_step(path.q) < 2.0 * largest_step(motion)


def test_where_the_arm_cannot_reach_the_rest_is_followed(rng):
    """A line that leaves the workspace and comes back: both parts are followed, and the first miss is named."""
    robot = mq.Robot.maira()
    solver = mq.Solver(robot)
    x = np.concatenate([np.linspace(0.5, 2.5, 60), np.linspace(2.5, 0.5, 60)])
    targets = [mq.pose([each, 0.1, 0.5], quaternion=[0, 1, 0, 0]) for each in x]
    path = solver.track(targets)
    alone = solver.solve_batch(targets)
    assert not path
    assert path.first_failure == np.flatnonzero(~alone.success)[0]
    np.testing.assert_array_equal(path.success, alone.success)
    assert "reach" in path.reason
    assert (path.q >= robot.lower).all()
    assert (path.q <= robot.upper).all()
    before = path.q[: path.first_failure]
    assert largest_step(before) < 0.5
    assert str(path.first_failure) in repr(path)


def test_a_turn_that_limits_end_is_named():
    """The tool circles the base by more than the first joint's range: it has to unwind once, by a whole turn."""
    robot = two_links()
    solver = mq.Solver(robot, task=mq.PositionTask())
    angles = np.linspace(-2.0, 6.0, 200)
    targets = [mq.pose([0.8 * np.cos(a), 0.8 * np.sin(a), 0.0], quaternion=[1, 0, 0, 0]) for a in angles]
    path = solver.track(targets)
    elbow = np.arccos(0.8)  # at the first joint, between the arm and the line to its tool
    assert not path
    assert path.success.all()
    assert path.reconfigurations == 1
    assert angles[path.first_failure] < 3.0 + elbow + 0.1
    assert "joint1 moves by" in path.reason
    assert solver.track(targets, max_reconfigurations=1)


def test_steps_stay_within_velocities(rng):
    """With a time between poses each joint keeps its speed; in too little time the result says who is too slow."""
    robot = load("panda")
    motion = smooth_motion(robot, rng)
    targets, solver = poses_along(robot, motion), mq.Solver(robot)
    path = solver.track(targets, motion[0], dt=0.1)
    assert path, path.reason
    assert (np.abs(np.diff(path.q, axis=0)) <= robot.velocity_limit * 0.1 * (1 + 1e-9)).all()
    hasty = solver.track(targets, motion[0], dt=1e-4)
    assert not hasty
    assert "velocity limit" in hasty.reason
    assert any(name in hasty.reason for name in robot.joint_names)


@pytest.mark.parametrize("name", ["maira", "panda", "ur5"])
def test_steps_that_are_hardly_larger_than_they_have_to_be(name):
    """What was found with any steps is found with its own as the largest that are allowed, and a little less."""
    robot = arm(name)
    solver, targets = mq.Solver(robot), circle(100)
    free = solver.track(targets)
    assert free, free.reason
    tight = solver.track(targets, max_step=1.01 * free.max_joint_step)
    assert tight, tight.reason
    assert tight.max_joint_step <= 1.01 * free.max_joint_step * (1 + 1e-9)


@pytest.mark.parametrize("name", ["maira", "panda"])
def test_lines_are_smooth(name):
    """Steps change little from pose to pose, as those of the tool do: no corners of a search are left in the line."""
    robot = arm(name)
    path = mq.Solver(robot).track(circle(200))
    assert path, path.reason
    steps, changes = np.diff(path.q, axis=0), np.diff(path.q, n=2, axis=0)
    assert np.abs(changes).max() < 0.1 * np.abs(steps).max()


@pytest.mark.parametrize("name", ["maira", "iiwa14"])
def test_a_line_does_not_begin_with_a_step_past_a_singular_configuration(name):
    """Which is all that finer layers find; between layers at all poses about it no such step has room."""
    robot, rng, u = mq.Robot.load(name), np.random.default_rng((1000, 14)), np.linspace(0, 1, 200)[:, None]
    a, b, c, d = rng.uniform(robot.lower, robot.upper, size=(4, 7))
    motion = (1 - u) ** 3 * a + 3 * u * (1 - u) ** 2 * b + 3 * u**2 * (1 - u) * c + u**3 * d
    p = mq.Solver(robot).track([robot.forward(q) for q in motion], motion[0])
    assert p
    assert p.max_joint_step < 3 * largest_step(motion)


def test_the_same_call_gives_the_same_path(rng):
    robot = mq.Robot.maira()
    targets = poses_along(robot, smooth_motion(robot, rng, 40))
    first, second = mq.Solver(robot).track(targets), mq.Solver(robot).track(targets)
    np.testing.assert_array_equal(first.q, second.q)


@pytest.mark.parametrize("is_whole", [True, False])
def test_progress_grows_to_the_number_of_poses_and_changes_nothing(is_whole, rng):
    robot, seen = mq.Robot.maira(), []
    targets = poses_along(robot, smooth_motion(robot, rng, 40))
    if not is_whole:
        targets[10:12, :3, 3] += 5.0
    path = mq.Solver(robot).track(targets, progress=lambda done, total: seen.append((done, total)))
    assert bool(path) is is_whole
    counts = [done for done, _ in seen]
    assert counts == sorted(counts)
    assert {total for _, total in seen} == {40}
    assert seen[-1] == (40, 40)
    assert len({*counts}) > 1
    np.testing.assert_array_equal(path.q, mq.Solver(robot).track(targets).q)


@pytest.mark.parametrize("at", [1, 5, 20])
def test_what_the_progress_callback_raises_ends_the_call(at, rng):
    robot, calls, solver = mq.Robot.maira(), [], mq.Solver(mq.Robot.maira())
    targets = poses_along(robot, smooth_motion(robot, rng, 40))

    def progress(done, total):
        calls.append(done)
        if len(calls) == at:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        solver.track(targets, progress=progress)
    assert len(calls) == at
    assert solver.track(targets)


@pytest.mark.parametrize("count", [0, 1, 2])
def test_short_paths(count):
    robot = mq.Robot.maira()
    targets = np.repeat(robot.forward(robot.middle + 0.1).homogeneous[None], count, axis=0)
    path = mq.Solver(robot).track(targets)
    assert path
    assert path.q.shape == (count, 7)
    assert path.max_joint_step < 1e-6


@pytest.mark.parametrize("step", [1e308, np.inf, [np.inf] * 7, {"joint1": np.inf}])
def test_any_step_may_be_allowed(step):
    path = mq.Solver(mq.Robot.maira()).track(circle(20), max_step=step)
    assert path, path.reason


def test_results_are_saved(rng):
    robot = mq.Robot.maira()
    path = mq.Solver(robot).track(poses_along(robot, smooth_motion(robot, rng, 20)))
    values = json.loads(json.dumps(path.as_dict()))
    np.testing.assert_array_equal(values["q"], path.q)
    again = pickle.loads(pickle.dumps(path))
    assert again.joint_names == robot.joint_names
    assert repr(again) == repr(path)


@pytest.mark.parametrize(
    ("changes", "error", "words"),
    [
        ({"dt": 0.0}, OptionError, "dt"),
        ({"dt": "soon"}, OptionError, "dt"),
        ({"max_step": -0.1}, OptionError, "max_step"),
        ({"max_step": [0.1, 0.2]}, OptionError, "max_step"),
        ({"max_step": float("nan")}, OptionError, "max_step must not be NaN"),
        ({"max_step": {"joint9": 0.1}}, OptionError, "'joint9' is not a joint"),
        ({"max_reconfigurations": 0.5}, OptionError, "max_reconfigurations"),
        ({"q0": [0.1]}, ConfigurationError, "q0"),
        ({"seed": -1}, OptionError, "seed"),
        ({"loop": "yes"}, OptionError, "loop"),
        ({"progress": 3}, OptionError, "progress"),
        ({"path": np.eye(4)}, PoseError, "path"),
        ({"path": np.zeros((3, 4, 4))}, PoseError, "path pose 0"),
        ({"path": np.full((2, 4, 4), np.nan)}, PoseError, "path pose 0"),
        ({"path": "here"}, PoseError, "path poses must be a sequence"),
    ],
)
def test_bad_calls_are_explained(changes, error, words):
    robot = mq.Robot.maira()
    call = {"path": [robot.forward(robot.middle)] * 3, **changes}
    with pytest.raises(error, match=words):
        mq.Solver(robot).track(**call)


def test_problems_that_are_not_taken_are_named():
    robot = mq.Robot.maira()
    with pytest.raises(OptionError, match="the axes of its task count differently"):
        mq.Solver(robot, task=mq.PoseTask(position_weight=[1, 1, 0])).track([robot.forward(robot.middle)] * 2)
    free = mq.Solver(robot, task=mq.PoseTask(orientation_weight=[1, 1, 0], axes="base"))
    with pytest.raises(OptionError, match=r'turn about one of its own axes is PoseTask.*axes="target"'):
        free.track([robot.forward(robot.middle)] * 2)
    row = np.array([0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    equal = mq.Solver(robot, limits=[mq.LinearLimit([row, -2 * row], [0.3, -0.6], name="parallelogram")])
    with pytest.raises(OptionError, match="'parallelogram' holds a sum of joints at one value"):
        equal.track([robot.forward(robot.middle)] * 2)


@pytest.mark.parametrize("seed", [0, 3, 5])
def test_further_limits_are_kept_along_the_path(seed):
    """The sum of two joints has a bound that the motion keeps; lines that are sought without it are beyond it here."""
    robot, rng = mq.Robot.maira(), np.random.default_rng(seed)
    motion = smooth_motion(robot, rng, 40)
    targets, row = poses_along(robot, motion), np.eye(7)[2:3] + np.eye(7)[4:5]
    bound = (motion @ row.T).max() + 0.05
    path = mq.Solver(robot, limits=[mq.LinearLimit(row, [bound])]).track(targets)
    assert path, path.reason
    assert (path.q @ row.T).max() <= bound + 1e-9
    assert (errors(robot, path.q, targets) < 1.1e-6).all()


def test_a_path_stays_clear_of_a_ball():
    """The tool moves along a line, and the elbow has to go around a ball that its own way leads through."""
    robot = mq.Robot.maira()
    targets = [mq.pose([0.5, y, 0.4], quaternion=[0, 1, 0, 0]) for y in np.linspace(-0.2, 0.2, 30)]
    free = mq.Solver(robot).track(targets)
    assert free, free.reason
    forearm = robot.forward(free.q[15], "link4").translation
    ball = mq.Sphere(0.08, mq.pose(forearm), name="ball")
    limit = mq.CollisionLimit(obstacles=[ball], margin=0.01, self_collision=False)
    kept = mq.Solver(robot, limits=[limit])
    assert kept.problem.limit_violations(robot.at(free.q[15]))
    path = kept.track(targets)
    assert path, path.reason
    middle = 0.5 * (path.q[1:] + path.q[:-1])
    assert not any(kept.problem.limit_violations(robot.at(q)) for q in (*path.q, *middle))


def circle(count: int = 100, turns: float = 1.0, radius: float = 0.15) -> np.ndarray:
    """Poses (count, 4, 4) on a circle in front of the arm, the tool down; the last is the first again."""
    angles = np.linspace(0.0, 2 * np.pi * turns, count)
    return np.array(
        [mq.pose([0.5, radius * np.cos(a), 0.5 + radius * np.sin(a)], rpy=[np.pi, 0, 0]).homogeneous for a in angles]
    )


@pytest.mark.parametrize("name", ["maira", "panda", "ur5"])
def test_a_loop_ends_as_it_begins(name):
    robot = arm(name)
    solver, targets = mq.Solver(robot), circle()
    path = solver.track(targets, loop=True)
    assert path, path.reason
    np.testing.assert_allclose(path.q[0], path.q[-1], atol=1e-6)
    again = solver.track(targets, q0=path.q[0], loop=True)
    assert again, again.reason
    np.testing.assert_allclose(again.q[[0, -1]], path.q[[0, 0]], atol=1e-6)


def test_a_loop_that_cannot_be_closed_says_so():
    """The tool goes round the base: the first joint ends a turn away, however the elbow is bent."""
    link = {"d": 0.0, "alpha": 0.0}
    wide = {"a": 0.5, "lower": -7.0, "upper": 7.0, **link}
    elbow = {"a": 0.5, "lower": 0.1, "upper": 3.0, **link}
    robot = mq.Robot.from_dh([wide, elbow])
    angles = np.linspace(0.0, 2 * np.pi, 150)
    targets = [mq.pose([0.8 * np.cos(a), 0.8 * np.sin(a), 0.0]) for a in angles]
    solver = mq.Solver(robot, task=mq.PositionTask())
    assert solver.track(targets)
    path = solver.track(targets, loop=True)
    assert not path
    assert path.first_failure == 149
    assert "joint1 ends 6.28 rad away" in path.reason
    endless = mq.Robot.from_dh([{"a": 0.5, "kind": "continuous", **link}, elbow])
    assert mq.Solver(endless, task=mq.PositionTask()).track(targets, loop=True)


def test_a_loop_that_is_not_closed_is_not_followed_whatever_may_be_reconfigured():
    """One joint goes round once: there is no large step on the way, and it does not end as it began."""
    robot = mq.Robot.from_dh([{"a": 0.3, "d": 0.0, "alpha": 0.0, "lower": -4.5, "upper": 4.5}])
    targets = poses_along(robot, np.linspace(-np.pi, np.pi, 40)[:, None])
    path = mq.Solver(robot).track(targets, q0=[-np.pi], loop=True, max_reconfigurations=1)
    assert not path
    assert path.reconfigurations == 0
    assert "whose end meets its beginning" in path.reason


@pytest.mark.parametrize(("turn", "closes"), [([0, 0, 1.0], True), ([0.4, 0, 0], False)])
def test_a_loop_of_a_tool_that_may_turn_is_closed_but_for_that(turn, closes):
    """The first pose and the last differ by a turn about an axis of the tool: the free one, or another."""
    tilted = mq.pose([0.5, 0.0, 0.5], rpy=[2.5, 0.4, 0.3])
    targets = [tilted * mq.pose([0.1 * np.cos(a), 0.1 * np.sin(a), 0]) for a in np.linspace(0, 2 * np.pi, 40)]
    targets[-1] = targets[0] * mq.pose(rpy=turn)
    solver = mq.Solver(mq.Robot.maira(), task=mq.PoseTask(orientation_weight=[1, 1, 0], axes="target"))
    if closes:
        path = solver.track(targets, loop=True)
        assert path, path.reason
        np.testing.assert_allclose(path.q[0], path.q[-1], atol=1e-6)
    else:
        with pytest.raises(PoseError, match="repeat the first pose"):
            solver.track(targets, loop=True)


def test_after_a_reconfiguration_joints_are_at_the_nearest_turn():
    """Four joints without limits: no step is larger than half a turn, not even where the arm leaves the path."""
    link = {"a": 0.3, "d": 0.0, "alpha": 0.0, "kind": "continuous"}
    robot = mq.Robot.from_dh([link] * 4)
    rng = np.random.default_rng(0)
    targets = [mq.pose([*rng.uniform(-0.6, 0.6, 2), 0.0]) for _ in range(30)]
    path = mq.Solver(robot, task=mq.PositionTask()).track(targets)
    assert path.success.all()
    assert path.reconfigurations > 0
    assert largest_step(path.q) < np.pi + 0.5


def test_a_loop_has_to_be_closed():
    with pytest.raises(PoseError, match="repeat the first pose at the end"):
        mq.Solver(mq.Robot.maira()).track(circle(turns=0.7), loop=True)


@pytest.mark.parametrize("name", ["panda", "ur5_limited", "irb140"])
def test_every_pose_that_can_be_reached_is(name):
    """Poses far apart, of a motion through the whole range: where no way is found the arm leaves the path, no more."""
    robot = arm(name)
    for seed in range(4):
        motion = np.random.default_rng(seed).uniform(
            np.maximum(robot.lower, -3), np.minimum(robot.upper, 3), (25, robot.n)
        )
        path = mq.Solver(robot).track(poses_along(robot, motion))
        assert path.success.all(), path.failures
        assert all(failure.is_step for failure in path.failures)


def test_parts_are_what_is_followed():
    """A line that leaves the workspace twice: parts and failures together are all poses."""
    robot = mq.Robot.maira()
    x = 1.3 + 0.6 * np.sin(np.linspace(0.0, 4 * np.pi, 120))
    path = mq.Solver(robot).track([mq.pose([each, 0.1, 0.5], quaternion=[0, 1, 0, 0]) for each in x])
    assert not path
    assert len(path.parts) == 3
    covered = [k for begin, end in path.parts for k in range(begin, end)]
    missed = [failure.index for failure in path.failures]
    assert sorted(covered + missed) == list(range(120))
    assert path.success[covered].all()
    assert not path.success[missed].any()
    for begin, end in path.parts:
        assert largest_step(path.q[begin:end]) < 0.5
    assert any(failure.is_proved for failure in path.failures)


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("name", ["ur5_limited", "kr210", "maira"])
def test_a_tool_that_may_turn_about_its_axis(name, axis):
    """The poses of a motion, each turned about an axis of the tool at random: turned back, the arm has done it."""
    robot, rng = arm(name), np.random.default_rng(axis)
    weights = np.where(np.arange(3) == axis, 0.0, 1.0)
    solver = mq.Solver(robot, task=mq.PoseTask(orientation_weight=weights, axes="target"))
    motion, direction = smooth_motion(robot, rng, 60), np.eye(3)[axis]
    turns = [pin.SE3(pin.exp3(angle * direction), np.zeros(3)).homogeneous for angle in rng.uniform(-3, 3, 60)]
    targets = poses_along(robot, motion) @ np.array(turns)
    for q0 in (None, motion[0]):
        path = solver.track(targets, q0=q0)
        assert path, path.reason
        assert path.q.shape == motion.shape
        assert largest_step(path.q) < min(0.5, 4 * largest_step(motion))
        assert ((path.q >= robot.lower) & (path.q <= robot.upper)).all()
        for q, target in zip(path.q, targets, strict=True):
            tool = robot.forward(q)
            assert np.linalg.norm(tool.translation - target[:3, 3]) < 1.1e-6
            assert np.linalg.norm(tool.rotation[:, axis] - target[:3, axis]) < 1.1e-6
    np.testing.assert_allclose(path.q[0], motion[0], atol=1e-6)
    assert not mq.Solver(robot).track(targets)


def test_further_limits_hold_where_the_tool_may_turn():
    robot = mq.Robot.maira()
    task, limit = mq.PoseTask(orientation_weight=[1, 1, 0], axes="target"), mq.LinearLimit(np.eye(7)[2:3], [0.3])
    path = mq.Solver(robot, task=task, limits=[limit]).track(circle(60), loop=True)
    assert path, path.reason
    assert path.q[:, 2].max() <= 0.3 + 1e-9
    assert path.joint_names == robot.joint_names


@pytest.mark.parametrize("redundancy", [mq.Strict(mq.Posture()), mq.Weighted(mq.Posture())])
def test_a_start_that_reaches_the_pose_is_kept(redundancy, rng):
    """Whatever the solver would make of the redundancy at a single pose."""
    robot = mq.Robot.maira()
    motion = smooth_motion(robot, rng, 40)
    path = mq.Solver(robot, redundancy=redundancy).track(poses_along(robot, motion), q0=motion[0])
    assert path, path.reason
    np.testing.assert_allclose(path.q[0], motion[0], atol=1e-9)


def test_a_long_way_out_of_reach_is_answered_pose_by_pose():
    x = np.concatenate([np.linspace(0.5, 3.0, 400), np.linspace(3.0, 0.5, 400)])
    robot = mq.Robot.maira()
    path = mq.Solver(robot).track([mq.pose([each, 0.1, 0.5], quaternion=[0, 1, 0, 0]) for each in x])
    assert len(path.parts) == 2
    assert all(failure.is_proved for failure in path.failures)
    assert ((path.q >= robot.lower) & (path.q <= robot.upper)).all()


def test_an_empty_path_can_be_looked_at():
    path = mq.Solver(mq.Robot.maira()).track([])
    assert "0 poses" in repr(path)
    assert path.parts == []
    assert path._repr_html_()


@pytest.mark.parametrize(("name", "seed"), [("maira", 2), ("panda", 3), ("xarm7", 3)])
@pytest.mark.parametrize("is_start_given", [False, True])
def test_a_posture_draws_on_the_line_and_steps_stay_as_small(name, seed, is_start_given):
    robot = arm(name)
    motion = smooth_motion(robot, np.random.default_rng(seed), 100)
    targets, start = poses_along(robot, motion), motion[0] if is_start_given else None
    posture = mq.Posture(robot.middle).of(robot)
    free = mq.Solver(robot).track(targets, start)
    for redundancy in (mq.Strict(posture), mq.Weighted(mq.LimitDistance())):
        drawn = mq.Solver(robot, redundancy=redundancy).track(targets, start)
        assert drawn, drawn.reason
        assert drawn.max_joint_step <= 1.21 * free.max_joint_step
        if isinstance(redundancy, mq.Strict):
            assert posture.costs(drawn.q).sum() < 0.97 * posture.costs(free.q).sum()
        if is_start_given:
            np.testing.assert_array_equal(drawn.q[0], free.q[0])


def test_a_loop_that_a_posture_draws_on_is_closed(rng):
    robot = mq.Robot.maira()
    path = mq.Solver(robot, redundancy=mq.Strict(mq.Posture())).track(circle(60), loop=True)
    assert path, path.reason
    np.testing.assert_allclose(path.q[-1], path.q[0], atol=1e-12)
