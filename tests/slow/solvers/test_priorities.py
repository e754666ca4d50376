"""Tasks at several priority levels, on chains and trees: what is reached, what is kept, and what may not be felt."""

import pickle
import time

import numpy as np
import pytest
from support.robots import TREES, load

import maira_qp as mq
from maira_qp.errors import FrameError, OptionError, PoseError
from maira_qp.problem.limits.joint import Tick, merge
from maira_qp.problem.qp.backends import Backend
from maira_qp.problem.qp.costs import LevelObjective, TaskCost, strict_levels
from maira_qp.problem.qp.hierarchy import solve_each_level
from maira_qp.solvers.reference.step import split_equalities


def poses(robot, q) -> dict:
    """Where a configuration (n,) puts the tips."""
    return {tip: robot.forward(q, tip) for tip in robot.tips}


@pytest.mark.parametrize("name", [*TREES, "panda", "xarm7", "ur5", "kinova", "tiago", "kr210", "puma560", "talos_arm"])
def test_every_robot_reaches_with_all_of_its_tips(name, rng):
    """Random reachable targets for all tips at once, each judged by a fresh forward kinematics."""
    robot = load(name)
    solver = mq.Solver(robot)
    for k in range(4):
        targets = poses(robot, robot.random_configuration(rng))
        s = solver.solve(targets if len(robot.tips) > 1 else targets[robot.tip], rng=k)
        assert s.success
        assert (robot.lower <= s.q).all()
        assert (s.q <= robot.upper).all()
        for tip, target in targets.items():
            error = mq.pose_error(robot.forward(s.q, tip), target)
            assert np.linalg.norm(error[:3]) <= 1e-6
            assert np.linalg.norm(error[3:]) <= 1e-6 * (1 + 1e-9)


def test_a_batch_of_targets_by_frame_is_the_targets_one_by_one(rng):
    robot = load("baxter_arms")
    solver = mq.Solver(robot)
    targets = [poses(robot, robot.random_configuration(rng)) for _ in range(3)]
    stacked = {tip: np.array([each[tip].homogeneous for each in targets]) for tip in robot.tips}
    one, other = solver.solve_batch(targets, seed=3), solver.solve_batch(stacked, seed=3)
    for i, each in enumerate(targets):
        alone = solver.solve(each, rng=3)
        assert np.array_equal(one[i].q, alone.q)
        assert np.array_equal(other[i].q, alone.q)
    stacked[robot.tip][1, 0, 3] = np.nan
    spoiled = solver.solve_batch(stacked, seed=3)
    assert spoiled.success.tolist() == [True, False, True]


def test_two_hands_hold_one_thing_wherever_it_goes(rng):
    """A relative pose above, the pose of one hand below it: level 1 is met though level 2 cannot be."""
    robot = load("baxter_arms")
    right, left = robot.tips
    q = robot.middle
    held = robot.forward(q, right).actInv(robot.forward(q, left))
    grip = mq.RelativePoseTask(frame=left, reference=right, target=held)
    solver = mq.Solver(robot, task=grip, tasks=[mq.PoseTask(frame=right, priority=2)])
    assert solver.solve({right: robot.forward(q, right)}).success
    far = robot.forward(q, right)
    far.translation = far.translation + np.array([5.0, 0, 0])
    for _ in range(150):
        q = solver.step(q, far, 0.02).q
    gripped = robot.forward(q, right).actInv(robot.forward(q, left))
    error = mq.pose_error(gripped, held)
    assert np.abs(error).max() < 1e-3
    assert robot.forward(q, right).translation[0] > robot.forward(robot.middle, right).translation[0] + 0.1


LEVELS = {
    "maira": lambda robot: [mq.PositionTask(), mq.AxisTask(direction=[0, 0, -1], priority=2)],
    "panda": lambda robot: [
        mq.PositionTask(position_weight=[1, 1, 0]),
        mq.LookAtTask(point=[2, 0, 1], priority=2),
        mq.JointCouplingTask(coefficients={"panda_joint1": 1.0, "panda_joint3": -1.0}, priority=3),
    ],
    "tiago": lambda robot: [mq.PoseTask(), mq.PositionTask(frame=robot.moved_links[3], priority=2)],
    "baxter_arms": lambda robot: [
        mq.PoseTask(frame=robot.tips[0]),
        mq.PositionTask(frame=robot.tips[1], priority=2),
        mq.AxisTask(frame=robot.tips[1], direction=[0, 0, 1], priority=3),
    ],
    "allegro": lambda robot: [mq.PositionTask(frame=tip, priority=1 + k) for k, tip in enumerate(robot.tips)],
}


@pytest.mark.parametrize("name", LEVELS)
def test_no_level_disturbs_one_above_it(name, rng):
    """800 ticks each, 300 of a hand, from q at limits, outside and singular too, with wishes at the second level."""
    robot = mq.Robot.maira() if name == "maira" else load(name)
    solver = mq.Solver(robot, task=LEVELS[name](robot), redundancy=mq.Strict(mq.Posture()))
    backend, worst, moved = Backend("daqp"), 0.0, 0
    for k in range(300 if name == "allegro" else 800):
        q = robot.random_configuration(rng)
        at_limit = rng.random(robot.n) < 0.2
        q = np.where(at_limit, np.where(rng.random(robot.n) < 0.5, *robot.drawn_range), q)
        q = np.where(rng.random(robot.n) < 0.1, 0.0, q)
        if k % 5 == 0:
            q = q + rng.choice([0, 1e-9, 0.1], robot.n) * rng.normal(size=robot.n)
        at = robot.at(q)
        goal = q + 10 ** rng.uniform(-4, 0) * rng.normal(size=robot.n)
        targets = {frame: robot.forward(goal, frame) for frame in solver.problem.target_keys}
        cost, wish = solver.problem.costs(targets)
        bounds = merge(solver.limits, at, Tick(0.02, np.zeros(robot.n)))
        levels = list(strict_levels(cost.level(at), cost, wish.objectives, at, bounds.held))
        wished = rng.normal(size=(2, robot.n)), 0.1 * rng.normal(size=2)
        mu = 1e-9 * np.abs(levels[0].H).max()
        levels[0] = levels[0].damped(mu)
        levels[1] = type(levels[1])(**{**vars(levels[1]), "wishes": wished})
        displacements = solve_each_level(levels, bounds, backend)[0]
        last = displacements[-1]
        for level, dq in zip(levels, displacements, strict=False):
            if level.rank_threshold < 1e-10:  # rows of tasks
                worst = max(worst, float(np.abs(level.rows @ (last - dq)).max(initial=0)))
        if len(displacements) > 1:
            reached = np.maximum(wished[0] @ displacements[1] - wished[1], 0)
            assert (wished[0] @ last - wished[1] <= reached + 1e-9).all()
        assert (last >= bounds.lower).all()
        assert (last <= bounds.upper).all()
        moved += len(displacements) > 1 and bool(np.abs(last - displacements[0]).max() > 1e-4)
    assert worst <= 1e-9
    assert moved > 200


def test_tasks_of_all_levels_are_met_where_that_is_possible(maira, rng):
    """A position, below it a direction: where both can be met a solve finds it, and settles the posture below both."""
    down = mq.AxisTask(direction=[0, 0, -1], priority=2)
    solver = mq.Solver(maira, task=mq.PositionTask(), tasks=[down], redundancy=mq.Strict(mq.Posture()))
    met = 0
    for k in range(6):
        target = mq.pose(maira.forward(maira.random_configuration(rng)).translation * [0.6, 0.6, 1])
        s = solver.solve(target, rng=k)
        assert s.success
        left = np.linalg.norm(down.of(maira).error(maira.at(s.q)))
        met += left < 1e-9
        both = mq.Solver(maira, task=[mq.PositionTask(), mq.AxisTask(direction=[0, 0, -1])]).solve(target, rng=k)
        assert left < 1e-9 or not both.success
    assert met > 2


def test_a_lower_level_that_cannot_be_met_is_as_near_as_the_first_allows(maira, rng):
    """Against projected steps: no small motion along the self-motion of level 1 brings level 2 nearer."""
    for k in range(4):
        elbow = mq.PositionTask(frame="link4", target=mq.pose([1.0, 1.0, 1.0]), priority=2)
        solver = mq.Solver(maira, tasks=[elbow])
        s = solver.solve(maira.forward(maira.random_configuration(rng)), rng=k)
        assert s.success
        if not s.optimal:
            continue
        made, J = elbow.of(maira), maira.jacobian(s.q)
        here = np.linalg.norm(made.error(maira.at(s.q)))
        direction = np.linalg.svd(J)[2][-1]
        for step in (1e-4, -1e-4):
            q = s.q + step * direction
            if (q == maira.clip(q)).all():
                assert np.linalg.norm(made.error(maira.at(q))) >= here - 1e-7


def test_an_equality_holds_exactly_while_the_arm_moves(maira):
    coupling = mq.JointCouplingTask(coefficients={"joint1": 1, "joint3": -1}, equality=True)
    solver = mq.Solver(maira, tasks=[coupling], redundancy=mq.Strict(mq.Posture()))
    q, goal = np.array([0.3, 0.2, 0.3, 0.5, 0, 0.3, 0]), np.array([1, 0.5, 1, 1, 0.3, -0.4, 0.2])
    for _ in range(200):
        t = solver.step(q, maira.forward(goal), 0.02)
        q = t.q
        assert abs(q[0] - q[2]) < 1e-12
    assert t.position_error < 1e-6


@pytest.mark.parametrize("backend", ["compiled", "daqp"])
def test_an_equality_goes_before_the_others_of_its_priority_at_any_level(maira, backend):
    """Two that contradict each other, below a position: the equality is met, or, without one, neither."""
    left = []
    for equality in (True, False):
        wishes = [
            mq.JointCouplingTask(coefficients={"joint3": 1}, value=0.2, priority=2, equality=equality),
            mq.JointCouplingTask(coefficients={"joint3": 1}, value=0.6, priority=2),
        ]
        q = np.array([0.2, 0.4, 0.0, 1.0, 0.1, 0.6, 0.0])
        solver = mq.Solver(maira, task=mq.PositionTask(), tasks=wishes, backend=backend)
        target = maira.forward(q)
        for _ in range(200):
            q = solver.step(q, target, 0.02).q
        left.append(abs(q[2] - 0.2))
    assert left[0] < 1e-6
    assert left[1] == pytest.approx(0.2, abs=1e-3)


def test_a_wish_yields_to_what_is_above_it_and_is_kept_where_it_can_be(maira, rng):
    """A bound on joint 3 below the pose: kept by the self-motion, against a posture that pulls the other way."""
    wish = mq.LimitTask(limit=mq.LinearLimit(np.eye(7)[[2]], [0.2]), priority=2)
    pull = mq.Strict(mq.Posture(1.5 * np.eye(7)[2], weights=np.eye(7)[2]))
    solver = mq.Solver(maira, tasks=[wish], redundancy=pull)
    q = np.array([0.2, 0.4, 0.0, 1.0, 0.1, 0.6, 0.0])
    target = maira.forward(q)
    for _ in range(300):
        t = solver.step(q, target, 0.02)
        q = t.q
        assert t.position_error < 2e-3
    assert q[2] == pytest.approx(0.2, abs=1e-4)
    free = mq.Solver(maira, redundancy=pull)
    for _ in range(300):
        q = free.step(q, target, 0.02).q
    assert q[2] > 0.3


def test_gain_and_damping_slow_a_tick_and_change_nothing_else(maira, rng):
    q = maira.random_configuration(rng)
    target = maira.forward(q + 1e-3 * rng.normal(size=7))
    whole, half, damped = (
        mq.Solver(maira, task=mq.PoseTask(**how)).step(q, target, 1.0) for how in ({}, {"gain": 0.5}, {"damping": 1e6})
    )
    first = np.linalg.norm(mq.pose_error(maira.forward(q), target)[:3])
    assert whole.position_error < 0.01 * first
    assert half.position_error == pytest.approx(0.5 * first, rel=0.02)
    assert np.linalg.norm(damped.velocity) < 0.9 * np.linalg.norm(whole.velocity)
    coupled = mq.JointCouplingTask(coefficients={"joint1": 1}, gain=0.25)
    assert mq.Solver(maira, task=coupled).step(np.full(7, 0.4), dt=1.0).q[0] == pytest.approx(
        0.3, abs=5e-3
    )  # and a little damping


def test_damping_below_the_task_keeps_the_rest_of_the_arm_still(maira):
    """Position of the elbow: the joints behind it have no part, and do not move; nor do they without the damping."""
    solver = mq.Solver(maira, task=mq.PositionTask(frame="link4"), tasks=[mq.DampingTask()])
    q = np.array([0.2, 0.4, 0.0, 1.0, 0.1, 0.6, 0.0])
    t = solver.step(q, mq.pose([0.3, 0.3, 0.8]), 0.01)
    assert np.abs(t.velocity[:3]).max() > 0
    assert np.abs(t.velocity[4:]).max() < 1e-12


def test_a_deadline_leaves_out_levels_and_breaks_no_limit(maira, monkeypatch):
    solver = mq.Solver(maira, redundancy=mq.Strict(mq.Posture()), backend="daqp")
    q = np.array([0.2, 0.4, 0.0, 1.0, 0.1, 0.6, 0.0])
    target = maira.forward(q + 0.2)
    alone = mq.Solver(maira, backend="daqp").step(q, target, 0.01)
    clock = iter(np.arange(0.0, 1e6, 10.0))
    monkeypatch.setattr(time, "monotonic", lambda: next(clock))
    hurried = solver.step(q, target, 0.01, deadline=1e-3)
    assert np.allclose(hurried.q, alone.q, atol=1e-12)


def test_equalities_of_a_level_go_before_its_other_tasks(maira):
    hard, soft = mq.JointCouplingTask(coefficients={"joint1": 1}, equality=True).of(maira), mq.DampingTask().of(maira)
    first, below = split_equalities(LevelObjective(TaskCost((soft, hard))))
    assert first.tasks.tasks == (hard,)
    assert below.tasks.tasks == (soft,)
    alone = LevelObjective(TaskCost((hard,)))
    assert split_equalities(alone) == (alone,)


def test_objectives_can_stand_between_tasks(maira, rng):
    """Manipulability above a posture, both below the pose: more of it than with the posture alone."""
    target = maira.forward(np.array([0.2, 0.4, 0.0, 1.0, 0.1, 0.6, 0.0]))
    above = mq.Solver(maira, tasks=[mq.ObjectiveTask(mq.Manipulability())], redundancy=mq.Strict(mq.Posture()))
    alone = mq.Solver(maira, redundancy=mq.Strict(mq.Posture()))
    start = np.array([0.2, 0.4, 0.0, 1.0, 0.1, 0.6, 0.0])
    one, other = above.solve(target, q0=start), alone.solve(target, q0=start)
    assert one.success
    assert maira.manipulability(one.q) >= maira.manipulability(other.q) - 1e-9


def test_targets_are_asked_for_by_frame(maira):
    robot = load("baxter_arms")
    solver, (right, left) = mq.Solver(robot), robot.tips
    pose = robot.forward(robot.middle)
    for call, error, message in [
        (lambda: solver.solve(pose), PoseError, "mapping"),
        (lambda: solver.solve({right: pose}), PoseError, f"{left!r} is missing"),
        (lambda: solver.solve({right: pose, "hand": pose}), FrameError, "hand"),
        (lambda: solver.solve({right: pose, left: np.eye(3)}), PoseError, "shape"),
        (lambda: solver.step(robot.middle, {right: pose}, 0.1), PoseError, "missing"),
        (lambda: solver.solve_batch([pose]), PoseError, "mapping"),
        (lambda: solver.solve_batch({right: [pose]}), PoseError, "mapping"),
        (lambda: solver.solve_batch({right: [pose], left: [pose, pose]}), PoseError, "as many"),
        (lambda: mq.Solver(maira, task=mq.AxisTask(direction=[0, 0, 1])).solve(np.eye(4)), PoseError, "no target"),
        (lambda: mq.Solver(maira, task=mq.AxisTask(direction=[0, 0, 1])).solve_batch([np.eye(4)]), PoseError, "batch"),
    ]:
        with pytest.raises(error, match=message):
            call()
    assert mq.Solver(maira, task=mq.AxisTask(direction=[0, 0, 1])).solve().success


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: mq.PoseTask(priority=0), "priority"),
        (lambda: mq.PoseTask(priority=1.5), "priority"),
        (lambda: mq.PoseTask(gain=0), "gain"),
        (lambda: mq.PoseTask(gain=1.5), "gain"),
        (lambda: mq.PoseTask(damping=-1), "damping"),
        (lambda: mq.PoseTask(equality="yes"), "equality"),
        (lambda: mq.PoseTask(axes="world"), "axes"),
        (lambda: mq.AxisTask(axis=[0, 0, 0], direction=[0, 0, 1]), "axis"),
        (lambda: mq.AxisTask(direction=[0, 0]), "direction"),
        (lambda: mq.AxisTask(direction=[0, 0, 1], target=np.eye(4)), "not both"),
        (lambda: mq.LookAtTask(point=[0, 0, np.inf]), "point"),
        (lambda: mq.JointCouplingTask(coefficients={}), "coefficients"),
        (lambda: mq.JointCouplingTask(coefficients={"joint1": 0}), "all 0"),
        (lambda: mq.JointCouplingTask(coefficients={"joint9": 1}).of(mq.Robot.maira()), "joint1"),
        (lambda: mq.DampingTask(weight=[1, 2]).of(mq.Robot.maira()), "7 of them"),
        (lambda: mq.SwivelTask(shoulder="link2", elbow="link4", wrist="link6", angle=np.nan), "angle"),
        (lambda: mq.LimitTask(limit=3), "limit"),
        (lambda: mq.ObjectiveTask(mq.Posture(), priority=1), "Weighted"),
        (lambda: mq.ObjectiveTask(mq.PoseTask()), "objective"),
        (lambda: mq.ObjectiveTask(mq.Posture(), weight=-1), "weight"),
    ],
)
def test_a_task_checks_what_it_is_made_of(make, message):
    with pytest.raises(OptionError, match=message):
        make()


def test_a_solver_with_many_levels_pickles(maira):
    solver = mq.Solver(
        maira,
        tasks=[
            mq.LookAtTask(frame="link6", point=[1, 0, 1], priority=2),
            mq.ObjectiveTask(mq.Manipulability(), priority=3),
            mq.LimitTask(limit=mq.LinearLimit(np.eye(7), np.ones(7)), priority=4),
        ],
    )
    again = pickle.loads(pickle.dumps(solver))
    target = maira.forward(np.array([0.2, 0.4, 0.0, 1.0, 0.1, 0.6, 0.0]))
    assert np.array_equal(again.step(np.zeros(7), target, 0.1).q, solver.step(np.zeros(7), target, 0.1).q)


def test_a_wish_may_be_a_collision_and_the_only_task(maira, rng):
    """What a wish reached is held while levels below it are settled: rows come and go with what is near."""
    ball = mq.CollisionLimit(obstacles=[mq.Sphere(0.15, mq.pose([0.4, 0, 0.6]))], margin=0.05, self_collision=False)
    wish = mq.LimitTask(limit=ball, priority=2)
    solver, watch = mq.Solver(maira, tasks=[wish], redundancy=mq.Strict(mq.Posture())), ball.of(maira)
    kept = 0
    for k in range(4):
        q = maira.random_configuration(rng)
        s = solver.solve(maira.forward(q), q0=q, rng=k)
        assert s.success
        kept += watch.distance(maira.at(s.q)) >= 0.05 - 1e-6
    assert kept >= 2
    bent = mq.LimitTask(limit=mq.LinearLimit(np.eye(7)[[3]], [-0.5]))
    s = mq.Solver(maira, task=bent, redundancy=mq.Strict(mq.Posture())).solve()
    assert s.success
    assert s.q[3] == pytest.approx(-0.5, abs=1e-6)  # as near to the posture, at 0, as the wish allows
    assert np.abs(np.delete(s.q, 3)).max() < 1e-5
