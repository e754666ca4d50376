"""The compiled tick against the reference engine, on chains and trees, at one to four levels; and what it promises.

Where two of a tick's numbers are the same but for rounding, the engines may decide differently: a level that can gain
nothing more, and whose cost the levels below may therefore not raise by a digit; rows that say nothing new, at a
singular configuration; limits that meet there. These ticks keep the promises too.
"""

import pickle

import numpy as np
import pytest
from support.own_tasks import height_task
from support.robots import load

import maira_qp as mq
from maira_qp.solvers.compiled.step import CompiledTick
from maira_qp.solvers.reference.step_models import bent_directions

ROBOTS = ["maira", "panda", "ur5", "tiago", "baxter_arms", "tiago_arms", "talos_arms", "allegro", "pr2_arms"]

STRICT, WEIGHTED = mq.Strict(mq.Posture()), mq.Weighted(mq.LimitDistance(), 1e-2)


def problems(robot: mq.Robot) -> dict[str, dict]:
    """Arguments of solvers, by a name."""
    first, *others = robot.tips
    above = [mq.PoseTask(frame=first), *(mq.PositionTask(frame=f, priority=2, gain=0.7, damping=0.5) for f in others)]
    return {
        "poses": {},
        "posture": {"redundancy": STRICT},
        "weighted": {"redundancy": WEIGHTED},
        "fading": {"redundancy": mq.Weighted(mq.Posture(), 1e-2, fading=True)},
        "levels": {"task": [mq.PositionTask(frame=first), *above[1:]], "redundancy": STRICT},
        "three": {"task": [*above, mq.ObjectiveTask(mq.Posture(), 0.5, priority=3, gain=0.5)]},
        "four": {"task": above, "redundancy": mq.Strict(mq.LimitDistance(), mq.Posture())},
    }


def double_pose_task() -> mq.Task:
    """A class that is derived from one that the kernel knows, and has another error."""

    class DoublePoseTask(mq.PoseTask):
        def error(self, at):
            return 2 * super().error(at)

        def jacobian(self, at):
            return 2 * super().jacobian(at)

    return DoublePoseTask()


def tasks_by_kind(robot: mq.Robot, rng) -> dict[str, dict]:
    """The same with every kind of task, alone and above, below and beside others."""
    tip, links = robot.tips[0], robot.moved_links
    middle, other = links[len(links) // 2], robot.tips[-1] if len(robot.tips) > 1 else links[len(links) // 2]
    pose, position = mq.PoseTask(frame=tip), mq.PositionTask(frame=tip)
    target, direction, point = robot.forward(robot.random_configuration(rng), tip), *rng.normal(size=(2, 3))
    uneven = {"frame": tip, "position_weight": [1, 0, 2], "orientation_weight": [0, 0.5, 1]}
    coupling = dict(zip(robot.joint_names, rng.normal(size=robot.n), strict=True))
    elbow = {"shoulder": links[1], "elbow": middle, "wrist": links[-2]}
    tasks = {
        "look": mq.LookAtTask(frame=tip, axis=direction, gain=0.6),
        "look at a point": [mq.LookAtTask(frame=tip, point=point), mq.PoseTask(frame=other, priority=2)],
        "axis": mq.AxisTask(frame=tip, direction=direction),
        "axis below": [position, mq.AxisTask(frame=tip, axis=direction, weight=2.0, damping=0.3, priority=2)],
        "uneven": mq.PoseTask(**uneven),
        "uneven in the target": mq.PoseTask(**uneven, axes="target"),
        "uneven below": [mq.AxisTask(frame=other, direction=direction), mq.PoseTask(**uneven, priority=2)],
        "even in the target": mq.PoseTask(frame=tip, axes="target", position_weight=[1, 2, 0]),
        "relative": mq.RelativePoseTask(frame=tip, reference=other, target=target),
        "relative below": [position, mq.RelativePoseTask(frame=tip, reference=other, target=target, priority=2)],
        "coupling": [mq.JointCouplingTask(coefficients=coupling, value=0.3), mq.PoseTask(frame=tip, priority=2)],
        "damping": [pose, mq.DampingTask(priority=1, weight=0.1)],
        "damping of some": [position, mq.DampingTask(weight=np.arange(robot.n) % 3)],
        "swivel": [pose, mq.SwivelTask(**elbow, angle=1.0, reference=(0.6, 0.8, 0))],
        "swivel first": mq.SwivelTask(**elbow, angle=-3.0, priority=1),
        "equality": [
            mq.PositionTask(frame=tip, equality=True),
            mq.OrientationTask(frame=tip),
            mq.AxisTask(frame=other),
        ],
        "equality below": [
            position,
            mq.AxisTask(frame=tip, direction=direction, priority=2, equality=True),
            mq.PoseTask(frame=other, priority=2),
        ],
    }
    problems = {label: {"task": task, "redundancy": STRICT} for label, task in tasks.items()}
    mixed = [mq.PoseTask(frame=tip, orientation_weight=[1, 0.2, 0]), mq.AxisTask(frame=tip, direction=direction)]
    problems["weighted beside two"] = {"task": mixed, "redundancy": WEIGHTED}
    problems["weighted below an equality"] = {"task": mq.PositionTask(equality=True), "redundancy": WEIGHTED}
    return problems


def test_a_level_bends_along_joints_of_one_arm_alone(rng):
    """Rounding does not mix directions in which a level bends across arms: mixed rows would hold up the other arm."""
    arm, two = rng.normal(size=(3, 4)), np.zeros((6, 8))
    two[:3, :4], two[3:, 4:] = arm, rng.normal(size=(3, 4))
    C = np.zeros((8, 8))
    for block, size in ((slice(0, 4), 1e-4), (slice(4, 8), 1e-10)):
        half = rng.normal(size=(4, 4))
        C[block, block] = size * (half + half.T)
    noise = 1e-15 * rng.normal(size=(8, 8))
    found = bent_directions(two, C + 1e-3 * (noise + noise.T), np.zeros(8, bool), 1e-8)
    assert len(found) == 1
    assert not found[0, 4:].any()
    assert np.linalg.norm(found[0]) == pytest.approx(1.0)


def robot_of(name: str, acceleration: float | None = None) -> mq.Robot:
    robot = mq.Robot.maira() if name == "maira" else load(name)
    return robot if acceleration is None else robot.limited(acceleration=acceleration)


def random_ticks(robot: mq.Robot, frames, rng, count: int):
    """q, targets, dt, velocity: targets near, far, out of reach, where it stands; inside, near, at, beyond limits."""
    lower, upper = np.maximum(robot.lower, -7), np.minimum(robot.upper, 7)
    for k in range(count):
        q = robot.random_configuration(rng)
        end = np.where(rng.random(robot.n) < 0.5, upper, lower)
        if k % 5 == 1:
            q = np.where(rng.random(robot.n) < 0.4, end, q)
        if k % 5 == 2:
            q = q + 0.3 * rng.normal(size=robot.n)
        if k % 5 == 3:
            q = np.clip(np.where(rng.random(robot.n) < 0.4, end + 1e-3 * rng.normal(size=robot.n), q), lower, upper)
        goal = robot.clip(q + rng.normal(size=robot.n) * (0.001, 0.1, 1.0)[k % 3])
        targets = {frame: robot.forward(goal if k % 7 else robot.clip(q), frame) for frame in frames}
        for pose in targets.values():
            pose.translation *= 1.0 if k % 4 else 1.5
        v = rng.normal(size=robot.n) * 0.3 * np.minimum(robot.velocity_limit, 10) * (k % 3 > 0)
        yield q, targets, (0.001, 0.01, 0.1, 1.0)[k % 4], v


def distance(a: mq.Step, b: mq.Step, dt: float) -> float:
    """The largest difference of two ticks of dt [s]."""
    off = max(np.abs(a.q - b.q).max(), np.abs(a.velocity - b.velocity).max() * dt)
    return float(max(off, abs(a.position_error - b.position_error), abs(a.orientation_error - b.orientation_error)))


def assert_ticks_agree(robot: mq.Robot, cases: dict, acceleration: float | None, rng) -> None:
    """Compiled ticks are those of the reference engine, but where one of them parts for a q moved by rounding."""
    ticks, differ = 0, []
    for label, arguments in cases.items():
        compiled, general = (mq.Solver(robot, backend=backend, **arguments) for backend in (None, "daqp"))
        assert compiled.engines.compiled_tick is not None, label
        assert general.engines.compiled_tick is None, label
        for q, targets, dt, v in random_ticks(robot, compiled.problem.target_keys, rng, 12):
            velocity = None if acceleration is None else v
            a, b = (solver.step(q, targets, dt, velocity=velocity) for solver in (compiled, general))
            assert (a.backend, b.backend) == ("compiled", "daqp")
            ticks += 1
            if distance(a, b, dt) < 1e-8:
                continue
            moved = q + 1e-13 * rng.normal(size=(8, robot.n))
            parted = max(
                distance(step, solver.step(at, targets, dt, velocity=velocity), dt)
                for step, solver in ((a, compiled), (b, general))
                for at in moved
            )
            if parted < 0.1 * distance(a, b, dt):
                differ.append((label, distance(a, b, dt)))
    assert len(differ) <= 0.005 * ticks, differ


@pytest.mark.parametrize("acceleration", [None, 5.0])
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.rounding) if name == "baxter_arms" else name for name in ROBOTS]
)
def test_the_compiled_tick_is_that_of_the_general_engine(name, acceleration, rng):
    robot = robot_of(name, acceleration)
    assert_ticks_agree(robot, problems(robot), acceleration, rng)


@pytest.mark.parametrize("acceleration", [None, 5.0])
@pytest.mark.parametrize(
    "name", ["panda", "ur5", pytest.param("tiago_arms", marks=pytest.mark.rounding), "baxter_arms"]
)
def test_every_kind_of_task_ticks_as_in_the_general_engine(name, acceleration, rng):
    robot = robot_of(name, acceleration)
    assert_ticks_agree(robot, tasks_by_kind(robot, rng), acceleration, rng)


@pytest.mark.parametrize("acceleration", [None, 5.0])
@pytest.mark.parametrize("name", ["panda", "tiago_arms", "allegro"])
def test_limits_hold_to_the_bit_over_many_ticks(name, acceleration, rng):
    robot = robot_of(name, acceleration)
    for label, arguments in problems(robot).items():
        solver = mq.Solver(robot, **arguments)
        q, v, dt = robot.random_configuration(rng), np.zeros(robot.n), 0.01
        for k in range(200):
            if k % 50 == 0:
                goal = robot.random_configuration(rng)
                targets = {frame: robot.forward(goal, frame) for frame in solver.problem.target_keys}
            t = solver.step(q, targets, dt, velocity=v)
            assert (np.abs(t.velocity) <= robot.velocity_limit).all(), label
            assert ((robot.lower <= t.q) & (t.q <= robot.upper)).all(), label
            assert (np.abs(t.velocity - v) <= robot.acceleration_limit * dt * (1 + 1e-9) + 1e-12).all(), label
            q, v = t.q, t.velocity


@pytest.mark.parametrize("name", ["panda", "baxter_arms", "tiago_arms", "pr2_arms", "talos_arms"])
def test_lower_levels_leave_those_above_as_they_are(name, rng):
    """Limits active or not, at singular configurations too: no tip is farther from its target than without them.

    But for the tolerances of the options, which are next to nothing here.
    """
    robot = robot_of(name)
    first, *others = robot.tips
    above = [mq.PoseTask(frame=first)]
    below = [mq.PositionTask(frame=frame, priority=2) for frame in others]
    options = mq.Options(level_position_tolerance=1e-10, level_orientation_tolerance=1e-10)
    solvers = [
        mq.Solver(robot, task=above, options=options),
        mq.Solver(robot, task=[*above, *below], options=options),
        mq.Solver(robot, task=[*above, *below], redundancy=STRICT, options=options),
    ]
    moved = 0
    for k, (q, targets, _, _) in enumerate(random_ticks(robot, robot.tips, rng, 200)):
        q = np.zeros(robot.n) if k % 9 == 0 else q
        steps = [solver.step(q, {f: targets[f] for f in solver.problem.target_keys}, 1e-3) for solver in solvers]
        for step, above_it, tip, rows in (
            *((step, steps[0], first, slice(0, 6)) for step in steps[1:]),
            (steps[2], steps[1], (others or [first])[0], slice(0, 3)),
        ):
            error, without = (mq.pose_error(robot.forward(t.q, tip), targets[tip])[rows] for t in (step, above_it))
            for part in (slice(0, 3), slice(3, 6)):
                assert np.linalg.norm(error[part]) <= np.linalg.norm(without[part]) + 1e-9
            moved += np.abs(step.q - above_it.q).max() > 1e-5
    assert moved > 50


@pytest.mark.parametrize("name", ["panda", "baxter_arms"])
def test_ticks_are_finite_wherever_they_begin(name, rng):
    robot = robot_of(name, 5.0)
    for arguments in problems(robot).values():
        solver = mq.Solver(robot, **arguments)
        for scale in (0.0, 1.0, 1e2, 1e4, 1e7):
            q = scale * rng.normal(size=robot.n)
            targets = {frame: robot.forward(robot.middle, frame) for frame in solver.problem.target_keys}
            for dt in (1e-9, 1e-3, 1e3):
                t = solver.step(q, targets, dt, velocity=np.zeros(robot.n))
                assert np.isfinite(t.q).all()
                assert (np.abs(t.velocity) <= robot.velocity_limit).all()


def test_what_is_wrong_is_said_as_by_the_general_engine(rng):
    robot = robot_of("baxter_arms", 5.0)
    solver, q, v = mq.Solver(robot), robot.middle.copy(), np.zeros(robot.n)
    good = {tip: robot.forward(q, tip) for tip in robot.tips}
    first, second = robot.tips
    nowhere, far = np.full((4, 4), np.nan), good[first].homogeneous
    far[0, 3] = 1e20
    for target in (None, good[first], {first: good[first]}, good | {"nobody": good[first]}, {first: nowhere} | good):
        if target == {first: good[first]} | good:
            continue
        with pytest.raises((mq.errors.PoseError, mq.errors.FrameError)):
            solver.step(q, target, 0.01, velocity=v)
    for wrong in (nowhere, far, "pose", np.eye(3)):
        with pytest.raises(mq.errors.PoseError):
            solver.step(q, good | {second: wrong}, 0.01, velocity=v)
    for wrong in (np.full(robot.n, np.nan), q[1:], "q"):
        with pytest.raises(mq.errors.ConfigurationError):
            solver.step(wrong, good, 0.01, velocity=v)
        with pytest.raises(mq.errors.ConfigurationError):
            solver.step(q, good, 0.01, velocity=wrong)
    with pytest.raises(mq.errors.OptionError):
        solver.step(q, good, 0.01)


def test_lists_and_integers_are_taken_too(rng):
    """Once they are arrays."""
    robot = robot_of("baxter_arms")
    solver, q = mq.Solver(robot, redundancy=STRICT), np.zeros(robot.n)
    targets = {tip: robot.forward(np.full(robot.n, 0.1), tip) for tip in robot.tips}
    a = solver.step(q, targets, 0.01)
    b = solver.step([0] * robot.n, {tip: pose.homogeneous.tolist() for tip, pose in targets.items()}, 0.01)
    assert a.backend == b.backend == "compiled"
    np.testing.assert_allclose(a.q, b.q, rtol=0, atol=1e-9)


def test_a_task_with_a_target_of_its_own_and_an_elbow(rng):
    robot, general = robot_of("panda"), "daqp"
    here = robot.forward(robot.middle + 0.1)
    tasks = [mq.PoseTask(target=here), mq.PositionTask(frame=robot.moved_links[3], priority=2)]
    a, b = (mq.Solver(robot, task=tasks, redundancy=STRICT, backend=backend) for backend in (None, general))
    assert a.engines.compiled_tick is not None
    target = robot.forward(robot.middle + 0.2, robot.moved_links[3])
    for _ in range(20):
        q = robot.random_configuration(rng)
        np.testing.assert_allclose(a.step(q, target, 0.01).q, b.step(q, target, 0.01).q, rtol=0, atol=1e-8)
    fixed = mq.Solver(robot, task=mq.PoseTask(target=here))
    assert fixed.engines.compiled_tick is not None
    assert fixed.step(robot.middle, None, 0.01).position_error > 0


def test_its_answer_counts_where_further_limits_do_not_bind(panda, rng):
    """A row that binds in some ticks and not in others: always the reference engine's answer, within the row."""
    limits, bound, general = [mq.LinearLimit(np.eye(7)[[0, 2]], [0.3, 0.3])], 0, 0
    fast, slow = (mq.Solver(panda, limits=limits, redundancy=STRICT, backend=backend) for backend in (None, "daqp"))
    free = mq.Solver(panda, redundancy=STRICT)
    for _ in range(150):
        q = panda.random_configuration(rng)
        q[[0, 2]] = np.minimum(q[[0, 2]], 0.3 - 0.02 * rng.random(2))
        target = panda.forward(q + 0.1 * rng.normal(size=7))
        a, b = fast.step(q, target, 0.02), slow.step(q, target, 0.02)
        assert np.abs(a.q - b.q).max() < 1e-7
        assert (a.q[[0, 2]] <= 0.3 + 1e-10).all()
        bound += bool(np.abs(free.step(q, target, 0.02).q - a.q).max() > 1e-6)
        general += a.backend == "daqp"
        assert a.backend in ("compiled", "daqp")
    assert 20 < bound <= general < 130


@pytest.mark.parametrize(
    "arguments",
    [
        {"redundancy": mq.Strict(mq.Manipulability())},
        {"redundancy": mq.Weighted(mq.Manipulability())},
        {"task": [mq.PoseTask(), mq.LimitTask(limit=mq.LinearLimit(np.eye(7)[:1], [0.1]), priority=2)]},
        {"task": [mq.PoseTask(), height_task()]},
        {"task": double_pose_task()},
        {"task": [mq.PoseTask(), mq.PositionTask(priority=2), mq.ObjectiveTask(mq.Posture())]},
        {"backend": "daqp"},
    ],
    ids=str,
)
def test_what_it_does_not_know_is_left_to_the_general_engine(arguments, panda):
    solver = mq.Solver(panda, **arguments)
    assert solver.engines.compiled_tick is None
    target = panda.forward(panda.middle) if solver.problem.target_keys else None
    step = solver.step(panda.middle, target, 0.01)
    assert np.isfinite(step.q).all()
    assert step.backend == "daqp"


def test_robots_with_mimic_joints_are_left_to_the_general_engine():
    robot = load("pr2_fingers")
    assert robot.kinematics.has_mimic
    assert mq.Solver(robot).engines.compiled_tick is None


def test_a_solver_with_a_compiled_tick_pickles(rng):
    robot = robot_of("baxter_arms")
    solver = mq.Solver(robot, redundancy=STRICT)
    twin = pickle.loads(pickle.dumps(solver))
    assert isinstance(twin.engines.compiled_tick, CompiledTick)
    targets = {tip: robot.forward(np.full(robot.n, 0.1), tip) for tip in robot.tips}
    a, b = (each.step(robot.middle, targets, 0.01) for each in (solver, twin))
    np.testing.assert_array_equal(a.q, b.q)
