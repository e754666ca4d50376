"""Where ticks come to rest, what they say of it, and what levels cost each other on the way."""

import pickle

import numpy as np
import pytest
from support.made_robots import mobile
from support.robots import load

import maira_qp as mq

BACKENDS = [None, "daqp"]


def conflict(kind, frame, target, elsewhere):
    """Two levels that cannot both be met."""
    if kind == "elbow":
        return [mq.PositionTask(target=target), mq.PositionTask(frame=frame, target=elsewhere, priority=2)]
    if kind == "look":
        return [
            mq.PositionTask(target=target),
            mq.LookAtTask(frame=frame, point=elsewhere.translation, priority=2),
        ]
    return [mq.OrientationTask(target=target), mq.PositionTask(target=elsewhere, priority=2)]


def until_rest(solver, q):
    """The last step of at most 20 s of ticks, and whether all joints stood for its last 30 ticks."""
    quiet = 0
    for _ in range(2000):
        step = solver.step(q, None, 0.01)
        q = step.q
        quiet = quiet + 1 if (np.abs(step.velocity) <= 1e-6 * solver.robot.velocity_limit).all() else 0
        if quiet >= 30:
            break
    return step, quiet >= 30


@pytest.mark.parametrize(
    ("name", "kind", "backend"),
    [
        *((name, kind, None) for name in ("maira", "panda", "iiwa14") for kind in ("elbow", "look", "orientation")),
        ("maira", "elbow", "daqp"),
        ("iiwa14", "look", "daqp"),
        ("maira", "orientation", "daqp"),
    ],
)
def test_two_levels_in_conflict_come_to_rest_and_stay(name, kind, backend):
    """At a millionth of the speed limits, within some seconds, for a third of a second and more."""
    robot = {"maira": mq.Robot.maira, "iiwa14": mq.Robot.iiwa14}.get(name, lambda: load(name))()
    for seed in range(3 if backend is None else 1):
        rng = np.random.default_rng(seed)
        target = robot.forward(robot.random_configuration(rng))
        elsewhere = mq.pose(rng.uniform(-1.5, 1.5, 3))
        q = robot.random_configuration(rng)
        solver = mq.Solver(robot, task=conflict(kind, robot.moved_links[3], target, elsewhere), backend=backend)
        step, quiet = until_rest(solver, q)
        assert quiet, seed
        assert step.status in (mq.StepStatus.NEAREST, mq.StepStatus.ARRIVED), seed


@pytest.mark.parametrize(
    ("name", "seeds", "backend"),
    [
        ("maira", (0, 2, 4, 7, 9, 10), None),
        ("panda", range(3), None),
        ("iiwa14", range(3), None),
        ("maira", [2], "daqp"),
    ],
)
def test_three_levels_in_conflict_come_to_rest(name, seeds, backend):
    """Through weak rows of a level at its edge, flat valleys beside a limit, and what looks like a saddle point."""
    robot = {"maira": mq.Robot.maira, "iiwa14": mq.Robot.iiwa14}.get(name, lambda: load(name))()
    for seed in seeds:
        rng = np.random.default_rng(seed)
        target, elsewhere = robot.forward(robot.random_configuration(rng)), mq.pose(rng.uniform(-1.5, 1.5, 3))
        tasks = [
            mq.PositionTask(target=target),
            mq.PositionTask(frame=robot.moved_links[3], target=elsewhere, priority=2),
            mq.OrientationTask(target=target, priority=3),
        ]
        solver = mq.Solver(robot, task=tasks, backend=backend)
        step, quiet = until_rest(solver, robot.random_configuration(rng))
        assert quiet, seed
        assert step.status == mq.StepStatus.NEAREST, seed


@pytest.mark.parametrize(
    ("within_reach", "seeds", "backend"),
    [(False, (3, 8, 19, 28), None), (True, (0, 3, 11, 12, 16), None), (False, [19], "daqp"), (True, [0], "daqp")],
)
def test_rows_of_rounded_right_angles_keep_no_arm_moving(within_reach, seeds, backend):
    """xArm7's link 4 keeps its distance from the shoulder but for the rounding of its model's angles.

    So one of the rows of its position is as weak as 1e-10 to 1e-6, and the level below must not move along it.
    """
    robot = load("xarm7")
    for seed in seeds:
        rng = np.random.default_rng(seed)
        target = robot.forward(robot.random_configuration(rng))
        if within_reach:
            elbow, point = robot.forward(robot.random_configuration(rng), "link4"), rng.uniform(-1, 1, 3)
        else:
            elbow, point = mq.pose(rng.uniform(-1.5, 1.5, 3)), rng.uniform(-1.5, 1.5, 3)
        tasks = [
            mq.OrientationTask(target=target),
            mq.PositionTask(frame="link4", target=elbow, priority=2),
            mq.LookAtTask(point=point, priority=3),
        ]
        solver = mq.Solver(robot, task=tasks, backend=backend)
        step, quiet = until_rest(solver, robot.random_configuration(rng))
        assert quiet, seed
        assert step.status == mq.StepStatus.NEAREST, seed


def random_task(robot, priority, rng):
    """A position, an orientation, a look or an axis, of the tip or of a link, as often out of reach as within."""
    frame = robot.tip if rng.random() < 0.5 else robot.moved_links[int(rng.integers(2, len(robot.moved_links)))]
    place = {"frame": frame, "priority": priority}
    reached, far = robot.forward(robot.random_configuration(rng), frame), mq.pose(rng.uniform(-1.5, 1.5, 3))
    return (
        lambda: mq.PositionTask(target=reached if rng.random() < 0.5 else far, **place),
        lambda: mq.OrientationTask(target=reached, **place),
        lambda: mq.LookAtTask(point=rng.uniform(-1.5, 1.5, 3), **place),
        lambda: mq.AxisTask(direction=rng.normal(size=3), **place),
    )[int(rng.integers(4))]()


@pytest.mark.parametrize("count", [2, 3, 4, 5])
@pytest.mark.parametrize("name", ["maira", "iiwa14", "panda", "ur5", "xarm7", "talos_arm"])
def test_random_levels_come_to_rest(name, count):
    """Of every kind, above a posture or not: of twenty scenes one may still move after 20 s."""
    robot = {"maira": mq.Robot.maira, "iiwa14": mq.Robot.iiwa14}.get(name, lambda: load(name))()
    moving = []
    for seed in range(20):
        rng = np.random.default_rng([seed, count])
        tasks = [random_task(robot, priority, rng) for priority in range(1, count + 1)]
        posture = mq.Strict(mq.Posture()) if rng.random() < 0.7 else None
        solver = mq.Solver(robot, task=tasks, redundancy=posture)
        step, quiet = until_rest(solver, robot.random_configuration(rng))
        if quiet:
            assert step.status in (mq.StepStatus.NEAREST, mq.StepStatus.ARRIVED, mq.StepStatus.STUCK), seed
        else:
            moving.append(seed)
    assert len(moving) <= 1, moving


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("name", ["maira", "iiwa14"])
def test_a_stretched_arm_leaves_its_singular_zeros(name, backend):
    """A target on the arm's own axis, whose gradient is zero there, is reached."""
    robot = mq.Robot.maira() if name == "maira" else mq.Robot.iiwa14()
    solver, q = mq.Solver(robot, task=mq.PositionTask(), backend=backend), np.zeros(robot.n)
    target = robot.forward(q)
    target.translation[2] -= 0.15
    for _ in range(600):
        step = solver.step(q, target, 0.01)
        q = step.q
        if step.status == mq.StepStatus.ARRIVED:
            break
    assert step.status == mq.StepStatus.ARRIVED
    assert step.position_error < 1e-4


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_step_says_what_the_arm_is_doing(backend):
    robot = mq.Robot.iiwa14()
    solver, q = mq.Solver(robot, redundancy=None, backend=backend), np.array([0.3, 0.5, 0.2, -1.2, 0.3, 0.8, 0.4])
    here, far = robot.forward(q), robot.forward(q)
    far.translation[:] = [2.0, 0.5, 1.0]
    arrived, moving = solver.step(q, here, 0.01), solver.step(q, far, 0.01)
    assert (arrived.status, moving.status) == (mq.StepStatus.ARRIVED, mq.StepStatus.MOVING)
    for _ in range(1500):
        step = solver.step(q, far, 0.01)
        q = step.q
        if step.status == mq.StepStatus.NEAREST:
            break
    assert step.status == mq.StepStatus.NEAREST
    assert step.position_error > 0.5
    assert (np.abs(step.velocity) <= 1e-6 * robot.velocity_limit).all()
    assert pickle.loads(pickle.dumps(step)).status is mq.StepStatus.NEAREST


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_gain_takes_its_share_of_the_error_along_a_straight_line(backend):
    """UR5 with a hundredth of the error a tick: the tool stays on the line, and each tick leaves 99 % of what is."""
    robot = load("ur5")
    solver = mq.Solver(robot, task=mq.PoseTask(gain=0.01), redundancy=None, backend=backend)
    q = np.array([0.5, -1.0, 1.2, 0.3, 1.0, 0.2])
    start, target = robot.forward(q), robot.forward(q)
    target.translation += [-0.1, 0.15, 0.1]
    line = target.translation - start.translation
    left = np.linalg.norm(line)
    for _ in range(200):
        step = solver.step(q, target, 0.01)
        q = step.q
        way = robot.forward(q).translation - start.translation
        assert np.linalg.norm(way - line * (way @ line) / (line @ line)) < 1e-3
        assert step.position_error / left == pytest.approx(0.99, abs=2e-3)
        left = step.position_error


@pytest.mark.parametrize("tolerance", [1e-5, 1e-3])
@pytest.mark.parametrize("backend", BACKENDS)
def test_what_lower_levels_cost_an_upper_one_is_bounded_in_metres(backend, tolerance):
    """Long ticks of an arm on a rail: the posture far away bends the way of the tool by the option at most."""
    robot = mobile("rail", 20.0)
    options = mq.Options(level_position_tolerance=tolerance, level_orientation_tolerance=tolerance)
    posture = mq.Strict(mq.Posture(np.r_[18.0, np.full(6, 0.5)]))
    alone = mq.Solver(robot, redundancy=None, backend=backend, options=options)
    both = mq.Solver(robot, redundancy=posture, backend=backend, options=options)
    q, moved = np.array([0.0, 0.3, 0.5, 0.9, 0.3, 0.8, 0.4]), 0.0
    target = robot.forward(q)
    for _ in range(20):
        first, step = alone.step(q, target, 0.1), both.step(q, target, 0.1)
        assert step.position_error <= first.position_error + tolerance * (1 + 1e-9)
        assert step.orientation_error <= first.orientation_error + tolerance * (1 + 1e-9)
        moved += np.abs(step.q - q).max()
        q = step.q
    assert moved > 1e-2
