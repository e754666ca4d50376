"""Long runs of control ticks: targets that jump, that cannot be reached, that lead through singularities and obstacles.

In every tick: no exception, no NaN, every limit kept. At rest in the end, wherever the target is.
"""

import numpy as np
import pytest
from support.robots import load

import maira_qp as mq


class Run:
    """A robot under control, watched."""

    def __init__(self, robot: mq.Robot, solver: mq.Solver, q: np.ndarray, dt: float = 0.01) -> None:
        self.robot, self.solver, self.dt = robot, solver, dt
        self.q, self.velocity = np.array(q), np.zeros(robot.n)

    def tick(self, target, dt: float | None = None) -> mq.Step:
        """One tick, all of whose limits are checked."""
        robot, dt = self.robot, self.dt if dt is None else dt
        t = self.solver.step(self.q, target, dt, velocity=self.velocity)
        assert np.isfinite(t.q).all()
        assert np.isfinite(t.velocity).all()
        inside = (self.q >= robot.lower) & (self.q <= robot.upper)
        assert (t.q >= robot.lower)[inside].all()
        assert (t.q <= robot.upper)[inside].all()
        assert (np.abs(t.velocity) <= robot.velocity_limit).all()
        change = robot.acceleration_limit * dt
        assert (np.abs(t.velocity - self.velocity) <= change * (1 + 1e-9) + 1e-12).all()
        assert np.abs(t.q - (self.q + dt * t.velocity)).max() <= 1e-12
        self.q, self.velocity = t.q, t.velocity
        return t

    def settles(self, target, ticks: int, speed: float = 1e-5) -> bool:
        """With the target at rest the joints come to rest within so many ticks, for good (a saddle lets go again)."""
        still = 0
        for _ in range(ticks):
            self.tick(target)
            still = still + 1 if np.abs(self.velocity).max() <= speed else 0
            if still == 100:
                return True
        return False


def targets_of(robot: mq.Robot, rng: np.random.Generator) -> dict:
    """Random poses for the tips: reachable, too far, or with every joint at zero (mostly singular)."""
    kind = rng.integers(4)
    goal = np.clip(np.zeros(robot.n), robot.lower, robot.upper) if kind == 0 else robot.random_configuration(rng)
    targets = {tip: robot.forward(goal, tip) for tip in robot.tips}
    if kind == 1:
        for pose in targets.values():
            pose.translation = pose.translation * rng.uniform(1, 10)
    return targets


def robot_of(name: str) -> mq.Robot:
    return mq.Robot.maira() if name == "maira" else load(name)


@pytest.mark.parametrize(
    ("name", "acceleration", "ticks"),
    [
        ("maira", None, 10_000),
        ("panda", None, 10_000),
        ("ur5", None, 10_000),
        ("kr210", None, 10_000),
        ("tiago", None, 3_000),
        ("maira", 5.0, 600),
        ("panda", 20.0, 600),
        ("baxter_arms", None, 300),
        ("allegro", 50.0, 200),
    ],
)
def test_no_tick_breaks_a_limit(name, acceleration, ticks, rng):
    robot = robot_of(name)
    if acceleration is not None:
        robot = robot.limited(acceleration=acceleration)
    solver = mq.Solver(robot, redundancy=mq.Strict(mq.Posture()))
    run = Run(robot, solver, robot.random_configuration(rng), dt=float(rng.choice([0.002, 0.01, 0.05])))
    for k in range(ticks):
        if k % 40 == 0:
            targets = targets_of(robot, rng)
        run.tick(targets)


@pytest.mark.parametrize("spread", [0.2, 2.0])
@pytest.mark.parametrize(
    ("name", "backend", "ticks"),
    [
        ("maira", None, 2000),
        ("panda", None, 2000),
        ("ur5", None, 1000),
        ("baxter_arms", None, 300),
        ("maira", "daqp", 150),
        ("kr210", "daqp", 150),
    ],
)
def test_limits_hold_whatever_sequence_of_dt(name, backend, ticks, spread, rng):
    """Ticks of 10 ms that vary by 20 %, or between 1 and 70 ms, toward targets at the limits of the joints."""
    robot, at_limit = robot_of(name).limited(acceleration=5.0), 0
    start = robot.random_configuration(rng)
    run = Run(robot, mq.Solver(robot, redundancy=mq.Strict(mq.Posture()), backend=backend), start)
    for k in range(ticks):
        if k % 100 == 0:
            beyond = robot.random_configuration(rng) * rng.uniform(1, 1.5)
            targets = {tip: robot.forward(beyond, tip) for tip in robot.tips}
        run.tick(targets, dt=0.01 * np.exp(spread * rng.uniform(-1, 1)))
        at_limit += ((run.q - robot.lower < 1e-3) | (robot.upper - run.q < 1e-3)).any()
    assert at_limit > ticks / 20 or name == "ur5" or backend == "daqp"


@pytest.mark.parametrize("backend", [None, "daqp"])
def test_a_velocity_that_no_braking_stops_ends_at_the_limit(maira, backend, rng):
    """At full speed right before a limit: position goes before acceleration, and q + v dt is the next q."""
    robot = maira.limited(acceleration=0.5)
    solver, dt = mq.Solver(robot, backend=backend), 0.01
    for _ in range(10):
        q, v = robot.random_configuration(rng), robot.velocity_limit * rng.choice([-1, 1], robot.n)
        q = np.where(rng.random(robot.n) < 0.5, np.where(v > 0, robot.upper - 0.03, robot.lower + 0.03), q)
        for _ in range(20):
            t = solver.step(q, robot.forward(robot.middle), dt * rng.uniform(0.5, 2), velocity=v)
            dt_now = np.abs(t.q - q).max() / np.abs(t.velocity).max()
            assert (robot.lower <= t.q).all()
            assert (t.q <= robot.upper).all()
            assert np.abs(t.q - (q + dt_now * t.velocity)).max() <= 1e-12
            q, v = t.q, t.velocity


@pytest.mark.parametrize("redundancy", [mq.Strict(mq.Posture()), mq.Weighted(mq.Posture())], ids=["strict", "weighted"])
@pytest.mark.parametrize("name", ["maira", "panda", "ur5", "kr210"])
def test_the_arm_comes_to_rest_whatever_the_target_is(name, redundancy, rng):
    robot = robot_of(name)
    solver, at_rest = mq.Solver(robot, redundancy=redundancy), 0
    for _ in range(12):
        run = Run(robot, solver, robot.random_configuration(rng), dt=0.01)
        at_rest += run.settles(targets_of(robot, rng), 8000)
    assert at_rest == 12


@pytest.mark.parametrize("name", ["maira", "panda"])
def test_an_arm_that_must_brake_comes_to_rest_too(name, rng):
    """Near targets: with limits on the acceleration an arm that is merely clipped swings about its goal for ever."""
    robot = robot_of(name).limited(acceleration=4.0)
    solver = mq.Solver(robot, redundancy=mq.Strict(mq.Posture()))
    for _ in range(2):
        q = 0.5 * (robot.random_configuration(rng) + robot.middle)
        run = Run(robot, solver, q, dt=0.02)
        target = robot.forward(robot.clip(q + 0.3 * rng.normal(size=robot.n)))
        assert run.settles(target, 600)
        assert run.tick(target).position_error < 1e-4


@pytest.mark.parametrize("backend", [None, "daqp"])
@pytest.mark.parametrize("name", ["maira", "iiwa14", "panda"])
def test_an_arm_that_must_brake_does_not_swing_about_the_nearest_point(name, backend, rng):
    """Positions out of reach at 1 rad/s^2: at rest for good within 20 s, at the promised 1e-6 of the speed limits."""
    robot = (mq.Robot.iiwa14() if name == "iiwa14" else robot_of(name)).limited(acceleration=1.0)
    solver = mq.Solver(robot, task=mq.PositionTask(), backend=backend)
    for _ in range(6 if backend is None else 1):
        run = Run(robot, solver, robot.random_configuration(rng), dt=0.02)
        target = robot.forward(robot.random_configuration(rng))
        target.translation *= rng.uniform(2, 5) * robot.length / np.linalg.norm(target.translation)
        assert run.settles(target, 1100, speed=1e-6 * robot.velocity_limit.min())
        assert run.tick(target).status == mq.StepStatus.NEAREST


def test_a_limit_is_reached_and_held_without_chatter(maira):
    """The target stands behind joint 4's limit: the joint arrives at it to the bit, at rest, and stays."""
    q = np.array([0.2, 0.4, 0.0, maira.upper[3] - 0.3, 0.1, 0.6, 0.0])
    beyond = q.copy()
    beyond[3] = maira.upper[3] + 0.2
    for robot in (maira, maira.limited(acceleration=3.0)):
        run = Run(robot, mq.Solver(robot), q, dt=0.01)
        assert run.settles(robot.forward(beyond), 2000)
    joint = maira.limited(lower={"joint4": -0.5}, upper={"joint4": 0.5}, acceleration=2.0)
    task = mq.JointCouplingTask(coefficients={"joint4": 1.0}, value=1.0)
    run = Run(joint, mq.Solver(joint, task=task), np.zeros(7), dt=0.01)
    assert run.settles(None, 400)
    assert run.q[3] == 0.5


def test_ticks_keep_clear_of_obstacles_and_come_to_rest_against_them(maira, rng):
    """A target inside a ball: the distance never falls below the margin, and the arm does not tremble."""
    ball = mq.Sphere(0.15, mq.pose([0.45, 0.0, 0.7]), name="ball")
    limit = mq.CollisionLimit(obstacles=[ball], margin=0.02)
    watch = limit.of(maira)
    for redundancy in (None, mq.Strict(mq.Posture())):
        solver = mq.Solver(maira, limits=[limit], redundancy=redundancy)
        q = np.array([2.0, 0.6, 0.0, 1.2, 0.1, 0.6, 0.0])
        assert watch.violation(maira.at(q)) == 0
        run = Run(maira, solver, q, dt=0.02)
        target = mq.pose([0.45, 0.0, 0.7], quaternion=[0, 1, 0, 0])
        for _ in range(150):
            run.tick(target)
            assert watch.distance(maira.at(run.q)) >= 0.02 - 1e-12
        assert run.settles(target, 300, speed=1e-3)


def test_an_arm_too_near_to_an_obstacle_moves_away_from_it(maira, rng):
    limit = mq.CollisionLimit(obstacles=[mq.Sphere(0.15, mq.pose([0.4, 0, 0.6]))], margin=0.02, self_collision=False)
    watch, solver, tried = limit.of(maira), mq.Solver(maira, limits=[limit]), 0
    while tried < 5:
        q = maira.random_configuration(rng)
        if not -0.04 < (before := watch.distance(maira.at(q))) < 0.01:
            continue
        tried += 1
        run = Run(maira, solver, q, dt=0.02)
        for _ in range(40):
            run.tick(maira.forward(q))
            now = watch.distance(maira.at(run.q))
            assert now >= min(before, 0.02) - 1e-12
            before = now
        assert before >= 0.02 - 1e-9


def test_a_broken_linear_limit_is_undone(maira):
    solver = mq.Solver(maira, limits=[mq.LinearLimit(np.ones((1, 7)), [0.5])])
    run = Run(maira, solver, np.full(7, 0.3), dt=0.01)
    for _ in range(100):
        run.tick(maira.forward(np.full(7, 0.3)))
    assert run.q.sum() <= 0.5 + 1e-9


def test_solve_keeps_clear_of_obstacles_and_says_what_stands_in_the_way(maira, rng):
    ball = mq.Sphere(0.15, mq.pose([0.4, 0.0, 0.6]), name="ball")
    limit = mq.CollisionLimit(obstacles=[ball], margin=0.02, self_collision=False)
    watch = limit.of(maira)
    solver = mq.Solver(maira, limits=[limit], redundancy=mq.Strict(mq.Posture()))
    solved = 0
    while solved < 8:
        q = maira.random_configuration(rng)
        if watch.violation(maira.at(q)) == 0:
            s = solver.solve(maira.forward(q), rng=solved)
            solved += 1
            assert s.success
            assert watch.distance(maira.at(s.q)) >= 0.02
    budget = mq.Options(max_restarts=5)
    s = mq.Solver(maira, limits=[limit], options=budget).solve(mq.pose([0.4, 0.0, 0.6], quaternion=[0, 1, 0, 0]))
    assert not s.success
    assert watch.distance(maira.at(s.q)) >= 0.02
    assert any("ball" in name for name in s.active_limits)


def test_a_tick_with_limited_acceleration_needs_the_velocity(maira):
    robot = maira.limited(acceleration=1.0)
    with pytest.raises(mq.errors.OptionError, match="velocity"):
        mq.Solver(robot).step(robot.middle, robot.forward(robot.middle), 0.01)
    with pytest.raises(mq.errors.ConfigurationError, match="velocity"):
        mq.Solver(robot).step(robot.middle, robot.forward(robot.middle), 0.01, velocity=np.full(7, np.nan))
    with pytest.raises(mq.errors.OptionError, match="deadline"):
        mq.Solver(robot).step(robot.middle, robot.forward(robot.middle), 0.01, velocity=np.zeros(7), deadline=-1)


@pytest.mark.parametrize("redundancy", [None, mq.Strict(mq.Posture(np.radians([0, 20, 0, 70, 0, 60, 0])))], ids=str)
@pytest.mark.parametrize("backend", [None, "daqp"])
def test_a_moving_target_does_not_set_the_arm_adrift(maira, redundancy, backend):
    """Once around a circle: no more joint travel than that of the pseudo-inverse, step by step."""
    q = plain = np.radians([0, 20, 0, 70, 0, 60, 0.0])
    start, solver, dt, travel = maira.forward(q), mq.Solver(maira, redundancy=redundancy, backend=backend), 0.01, [0, 0]
    for k in range(314):
        angle = 2 * dt * (k + 1)
        target = start.copy()
        target.translation = start.translation + 0.15 * np.array([np.cos(angle) - 1, np.sin(angle), 0])
        ahead = solver.step(q, target, dt).q
        moved = plain + np.linalg.pinv(maira.jacobian(plain)) @ mq.pose_error(maira.forward(plain), target)
        travel[0] += np.linalg.norm(ahead - q)
        travel[1] += np.linalg.norm(moved - plain)
        q, plain = ahead, moved
    assert travel[0] < 1.1 * travel[1]


def balls(rng: np.random.Generator, count: int = 5) -> list[mq.Sphere]:
    """Obstacles anywhere around an arm, some of them upon it."""
    places = rng.uniform([-0.8, -0.8, 0.1], [0.8, 0.8, 1.3], (count, 3))
    return [mq.Sphere(radius, mq.pose(p)) for radius, p in zip(rng.uniform(0.08, 0.2, count), places, strict=True)]


@pytest.mark.parametrize("acceleration", [None, 4.0])
@pytest.mark.parametrize("name", ["maira", "iiwa14"])
def test_among_broken_margins_no_pair_comes_nearer(name, acceleration, rng):
    """Each pair by itself: one inside its margin comes no nearer, one outside stays there; many of them come out."""
    robot = mq.Robot.iiwa14() if name == "iiwa14" else robot_of(name)
    robot = robot if acceleration is None else robot.limited(acceleration=acceleration)
    begun, ended, tried = 0, 0, 0
    while tried < 2:
        limit = mq.CollisionLimit(obstacles=balls(rng), margin=0.05)
        scene, q = limit.of(robot).scene, robot.random_configuration(rng)
        target = robot.forward(robot.random_configuration(rng))

        def distances(q: np.ndarray) -> np.ndarray:
            """Of all pairs (k,) [m], up to 0.3."""
            contacts = scene.contacts(q, 0.3)  # noqa: B023
            found = np.full(len(scene.pairs), 0.3)  # noqa: B023
            found[contacts.pairs] = contacts.distances
            return found

        before = distances(q)
        if (before < 0.05).sum() < 3:
            continue
        tried, begun = tried + 1, begun + (before < 0.05).sum()
        run = Run(robot, mq.Solver(robot, limits=[limit], redundancy=mq.Strict(mq.Posture())), q)
        for _ in range(60):
            run.tick(target)
            now = distances(run.q)
            assert (now >= np.minimum(before, 0.05) - 1e-9).all()
            before = now
        ended += (before < 0.05).sum()
    assert ended < begun


@pytest.mark.parametrize(("acceleration", "seed", "ticks"), [(None, 12, 60), (4.0, 21, 85)])
def test_no_pair_comes_nearer_behind_one_that_is_deeper(acceleration, seed, ticks):
    """Scenes in which pairs did, when what is broken was compared by its maximum."""
    rng, obstacles, robot = np.random.default_rng(seed), [], mq.Robot.maira()
    for _ in range(5):
        p = rng.uniform(-0.8, 0.8, 3)
        p[2] = rng.uniform(0.1, 1.3)
        obstacles.append(mq.Sphere(float(rng.uniform(0.08, 0.2)), mq.pose(p)))
    robot = robot if acceleration is None else robot.limited(acceleration=acceleration)
    limit = mq.CollisionLimit(obstacles=obstacles, margin=0.05)
    watch, solver = limit.of(robot), mq.Solver(robot, limits=[limit], redundancy=mq.Strict(mq.Posture()))
    run = Run(robot, solver, robot.random_configuration(rng))
    target = robot.forward(robot.random_configuration(rng))
    before = watch.scene.contacts(run.q, np.inf).distances
    for _ in range(ticks):
        run.tick(target)
        now = watch.scene.contacts(run.q, np.inf).distances
        assert (now >= np.minimum(before, 0.05) - 1e-9).all()
        before = now


@pytest.mark.parametrize(("acceleration", "dt", "seed"), [(20.0, 0.005, 2), (3.0, 0.02, 3), (0.5, 0.05, 4)])
def test_joints_stop_before_limits_of_sums(acceleration, dt, seed):
    """However fast targets jump: with limited accelerations a row that is kept at every tick needs room to stop."""
    rng, A, b = np.random.default_rng(seed), np.zeros((4, 7)), np.array([0.8, 1.0, 0.5, 0.5])
    A[0, [1, 3]], A[1, [1, 3]], A[2, [0, 2, 4]], A[3, [0, 2, 4]] = 1.0, -1.0, [1, -1, 0.5], [-1, 1, -0.5]
    robot = mq.Robot.maira().limited(acceleration=acceleration)
    solver = mq.Solver(robot, limits=[mq.LinearLimit(A, b)])
    drawn = (robot.random_configuration(rng) for _ in range(1000))
    q, v, worst, nearest = next(q for q in drawn if (A @ q < b).all()), np.zeros(7), -np.inf, np.inf
    for k in range(120):
        if k % 30 == 0:
            target = robot.forward(robot.random_configuration(rng))
        t = solver.step(q, target, dt=dt, velocity=v)
        assert (np.abs(t.velocity - v) <= acceleration * dt * (1 + 1e-9)).all()
        q, v = t.q, t.velocity
        worst, nearest = max(worst, (A @ q - b).max()), min(nearest, (b - A @ q).min())
    assert worst <= 1e-9
    assert nearest < 0.05  # the limits matter
