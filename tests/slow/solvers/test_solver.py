"""The solver: reachable targets are reached, limits hold to the bit, and a success is a success."""

import pickle
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields

import numpy as np
import pinocchio as pin
import pytest
from support.robots import load

import maira_qp as mq
from maira_qp.errors import BackendError, ConfigurationError, FrameError, OptionError, PoseError

BACKENDS = ["daqp", "proxqp", "osqp", "piqp", "clarabel"]
MAIRA = mq.Robot.maira().dh
LOOSE_OSQP = mq.Backend("osqp", {"eps_abs": 1e-3, "eps_rel": 1e-3})  # its own defaults


def pose_error(robot: mq.Robot, q: np.ndarray, target: pin.SE3) -> float:
    """Larger of position [m] and orientation [rad] error, by the DH chain or a fresh Pinocchio model."""
    if robot.dh is not None:
        T = robot.dh.forward(q)
    else:
        data = robot.model.createData()
        pin.framesForwardKinematics(robot.model, data, q)
        T = data.oMf[robot.model.getFrameId(robot.tip)].homogeneous
    angle = np.linalg.norm(pin.log3(target.rotation @ T[:3, :3].T))
    return max(float(np.linalg.norm(target.translation - T[:3, 3])), float(angle))


FAR = np.block([[np.eye(3), np.full((3, 1), 1e12)], [np.zeros((1, 3)), np.ones((1, 1))]])
"""A pose a million million metres away."""


def inside(robot: mq.Robot, q: np.ndarray) -> bool:
    return bool(np.isfinite(q).all() and (q >= robot.lower).all() and (q <= robot.upper).all())


@pytest.mark.parametrize("backend", BACKENDS)
def test_every_reachable_target_is_reached_by_every_backend(maira, backend):
    """Random reachable targets from random starts, default options, judged by the DH chain: 200 by the default."""
    solver = mq.Solver(maira, backend=backend)
    rng = np.random.default_rng(1)
    for k in range(200 if backend == "daqp" else 40):
        target = maira.forward(maira.random_configuration(rng))
        s = solver.solve(target, q0=maira.random_configuration(rng), rng=k)
        assert s.success, (k, s.status)
        assert s.status is mq.Status.CONVERGED
        assert inside(maira, s.q)
        assert pose_error(maira, s.q, target) <= 1.01e-6


@pytest.mark.parametrize("name", ["panda", "xarm7", "ur5", "ur5_limited", "pr2_arm", "tiago", "kr210", "panda_finger"])
def test_real_robots_reach_their_targets(name):
    """Limits of all kinds: one-sided, beyond 2 pi, none (continuous), prismatic, mimic."""
    robot = load(name)
    solver, rng = mq.Solver(robot), np.random.default_rng(2)
    for k in range(60):
        target = robot.forward(robot.random_configuration(rng))
        s = solver.solve(target, rng=k)
        assert s.success, (k, s.status)
        assert inside(robot, s.q)
        assert pose_error(robot, s.q, target) <= 1.01e-6


@pytest.mark.parametrize("joints", [1, 2, 3, 12])
def test_arms_of_any_number_of_joints(joints, rng):
    """Fewer than six reach what they can reach; the rank is not full anywhere."""
    links = [mq.DHLink(a=0.3, alpha=(0.0 if joints < 4 else np.pi / 2 * (-1) ** i)) for i in range(joints)]
    robot = mq.Robot.from_dh(links)
    solver = mq.Solver(robot)
    for k in range(20):
        target = robot.forward(robot.random_configuration(rng))
        s = solver.solve(target, rng=k)
        assert s.success
        assert pose_error(robot, s.q, target) <= 1.01e-6


@pytest.mark.parametrize("distance", [1e-2, 1e-4, 0.0])
def test_targets_with_every_joint_near_a_limit_are_reached(maira, distance):
    solver, rng = mq.Solver(maira, options=mq.Options(max_restarts=1000)), np.random.default_rng(3)
    for k in range(40):
        off = distance * rng.random(7)
        q = np.where(rng.random(7) < 0.5, maira.lower + off, maira.upper - off)
        s = solver.solve(maira.forward(q), rng=k)
        assert s.success, k
        assert inside(maira, s.q)


@pytest.mark.parametrize("backend", [*BACKENDS, LOOSE_OSQP], ids=[*BACKENDS, "osqp at its defaults"])
@pytest.mark.parametrize(
    "redundancy", [None, mq.Strict(mq.Posture()), mq.Weighted(mq.Posture())], ids=["none", "strict", "weighted"]
)
def test_limits_and_verdict_hold_for_reachable_and_unreachable_targets(maira, backend, redundancy):
    """No backend, however inaccurate, costs a limit or a false success; what is not solved has its true error."""
    options = mq.Options(max_restarts=3)
    solver, rng = mq.Solver(maira, backend=backend, redundancy=redundancy, options=options), np.random.default_rng(4)
    for k in range(9):
        target = maira.forward(maira.random_configuration(rng))
        if k % 3 == 0:
            target.translation *= 1.6
        s = solver.solve(target, rng=k)
        error = pose_error(maira, s.q, target)
        assert inside(maira, s.q)
        assert s.success == (s.status is mq.Status.CONVERGED)
        assert s.success == (max(s.position_error, s.orientation_error) <= 1e-6)
        assert max(s.position_error, s.orientation_error) == pytest.approx(error, abs=1e-9)


def test_an_unreachable_target_gives_a_stationary_nearest_point(maira, rng):
    """No small motion within the limits lowers the cost `1/2 |W e|^2`: tried in 30 directions."""
    solver = mq.Solver(maira, options=mq.Options(max_restarts=5))

    def cost(q, target):
        error = mq.pose_error(maira.forward(q).homogeneous, target.homogeneous)
        return 0.5 * np.sum((solver.tasks[0].weights * error) ** 2)

    for k in range(10):
        target = maira.forward(maira.random_configuration(rng))
        target.translation *= 2.5 / np.linalg.norm(target.translation)
        s = solver.solve(target, rng=k)
        assert s.status is mq.Status.UNREACHABLE
        assert s.optimal
        assert not s.success
        assert s.projected_gradient <= 1e-6
        here = cost(s.q, target)
        for _ in range(30):
            for size in (1e-2, 1e-4):
                moved = maira.clip(s.q + size * rng.normal(size=7))
                assert cost(moved, target) >= here - 1e-9 * size


def test_the_nearest_point_to_a_far_away_position_is_at_full_stretch(maira):
    """Known by geometry: for position alone, the reach of 1.515 m around the shoulder, toward the target."""
    shoulder = np.array([0.0, 0.0, 0.438])
    target = np.array([2.0, 1.0, 1.5])
    s = mq.Solver(maira, task=mq.PositionTask()).solve(mq.pose(target))
    assert s.status is mq.Status.UNREACHABLE
    assert s.optimal
    assert s.position_error == pytest.approx(np.linalg.norm(target - shoulder) - 1.515, abs=1e-6)


@pytest.mark.parametrize("size", [1e-3, 1e-2, 100.0])
def test_arms_of_any_size_are_the_same_problem(size, rng):
    """MAIRA a thousand times smaller, a hundred times larger: every target reached, nearest points found."""
    links = [mq.DHLink(d=size * link.d, alpha=link.alpha, lower=link.lower, upper=link.upper) for link in MAIRA.links]
    robot = mq.Robot.from_dh(links)
    options = mq.Options(position_tolerance=1e-6 * size, max_restarts=20)
    for redundancy in (None, mq.Strict(mq.Posture())):
        solver = mq.Solver(robot, redundancy=redundancy, options=options)
        for k in range(15):
            s = solver.solve(robot.forward(robot.random_configuration(rng)), rng=k)
            assert s.success
            assert redundancy is None or s.projected_gradient <= 1e-6
        for far in (3, 500):
            s = solver.solve(mq.pose([far * size, 0, 0]))
            assert s.status is mq.Status.UNREACHABLE
            assert s.optimal


def test_a_target_beyond_all_numbers_is_a_mistake(maira):
    with pytest.raises(PoseError, match="times the arm's length"):
        mq.Solver(maira).solve(mq.pose([1e308, 0, 0]))
    with pytest.raises(PoseError, match="target 1 is 1e"):
        mq.Solver(maira).solve_batch([mq.pose([1, 0, 0]), mq.pose([1e12, 0, 0])])


def test_a_start_at_the_target_stays_there(maira, rng):
    q = maira.random_configuration(rng)
    s = mq.Solver(maira).solve(maira.forward(q), q0=q)
    assert np.array_equal(s.q, q)
    assert (s.iterations, s.restarts, s.start_projected) == (0, 0, False)


def test_a_start_outside_the_limits_is_moved_onto_them_and_said(maira):
    q0 = np.full(7, 9.0)
    s = mq.Solver(maira).solve(maira.forward(np.full(7, 0.4)), q0=q0)
    assert s.success
    assert s.start_projected
    assert q0.tolist() == [9.0] * 7


def test_active_limits_are_named(maira):
    q = np.array([0.1, maira.upper[1], 0.2, maira.lower[3], 0.3, 0.4, 0.5])
    s = mq.Solver(maira).solve(maira.forward(q), q0=q)
    assert s.active_limits == ["joint2 upper", "joint4 lower"]


def test_a_locked_joint_stays_where_it_is_locked(rng):
    links = [*mq.Robot.maira().dh.links]
    links[2] = mq.DHLink(d=0.7, alpha=-np.pi / 2, lower=0.25, upper=0.25)
    robot = mq.Robot.from_dh(links)
    for redundancy in (None, mq.Strict(mq.Posture()), mq.Weighted(mq.Posture(), 1e-9)):
        solver = mq.Solver(robot, redundancy=redundancy)
        for k in range(10):
            s = solver.solve(robot.forward(robot.random_configuration(rng)), rng=k)
            assert s.success
            assert s.q[2] == 0.25
            assert {"joint3 lower", "joint3 upper"} <= set(s.active_limits)


def test_a_coupled_limit_holds_and_is_obeyed_by_every_start(maira, rng):
    """q2 + q4 <= 0.5, |q1 - q3| <= 2: targets that respect it are reached within it."""
    A = np.array([[0, 1, 0, 1, 0, 0, 0], [1, 0, -1, 0, 0, 0, 0], [-1, 0, 1, 0, 0, 0, 0]], dtype=float)
    b = np.array([0.5, 2.0, 2.0])
    for redundancy in (None, mq.Strict(mq.Posture())):
        solver = mq.Solver(maira, limits=[mq.LinearLimit(A, b)], redundancy=redundancy)
        reached = 0
        while reached < 20:
            q = maira.random_configuration(rng)
            if (A @ q > b).any():
                continue
            s = solver.solve(maira.forward(q), q0=maira.random_configuration(rng), rng=reached)
            assert s.success
            assert (A @ s.q <= b + 1e-9).all()
            assert inside(maira, s.q)
            reached += 1


def test_limits_that_leave_nothing_are_refused(maira):
    A = np.array([[1.0, 0, 0, 0, 0, 0, 0]])
    with pytest.raises(OptionError, match="no configuration satisfies"):
        mq.Solver(maira, limits=[mq.LinearLimit(A, [-4.0])])


def test_further_tasks_are_reached_together(maira, rng):
    for k in range(10):
        q = maira.random_configuration(rng)
        elbow = mq.PositionTask(frame="link4", target=maira.forward(q, "link4"))
        s = mq.Solver(maira, tasks=[elbow]).solve(maira.forward(q), rng=k)
        assert s.success
        assert np.linalg.norm(maira.forward(s.q, "link4").translation - elbow.target.translation) <= 1e-6
        assert pose_error(maira, s.q, maira.forward(q)) <= 1.01e-6


def test_the_deadline_ends_a_search(maira):
    target = mq.pose([5, 0, 0])
    s = mq.Solver(maira, options=mq.Options(deadline=1e-9)).solve(target)
    assert s.status is mq.Status.BUDGET_SPENT
    assert inside(maira, s.q)
    assert s.restarts < 8  # the eight attempts that run side by side
    general = mq.Solver(maira, options=mq.Options(deadline=1e-9), backend="daqp").solve(target)
    assert general.status is mq.Status.BUDGET_SPENT
    assert general.restarts == 0


@pytest.mark.parametrize(
    "options", [mq.Options(max_restarts=0, max_iterations=1), mq.Options(max_settling=0, max_restarts=0)]
)
def test_small_budgets_are_kept(maira, options, rng):
    for k in range(20):
        s = mq.Solver(maira, options=options).solve(mq.pose([3, 0, 0]), rng=k)
        assert s.restarts == 0
        assert inside(maira, s.q)
        assert s.status is mq.Status.UNREACHABLE


def test_tolerances_are_those_of_the_options(maira, rng):
    target, q0 = maira.forward(maira.random_configuration(rng)), maira.random_configuration(rng)
    loose, tight = (
        mq.Solver(maira, options=mq.Options(position_tolerance=size, orientation_tolerance=size)).solve(target, q0)
        for size in (1e-2, 1e-12)
    )
    assert loose.success
    assert tight.success
    assert max(tight.position_error, tight.orientation_error) <= 1e-12
    assert loose.iterations < tight.iterations


def test_the_same_call_gives_the_same_answer_and_a_seed_another(maira, rng):
    target = maira.forward(maira.random_configuration(rng))
    solver = mq.Solver(maira)
    first = solver.solve(target)
    assert np.array_equal(first.q, solver.solve(target).q)
    assert np.array_equal(first.q, solver.solve(target, rng=0).q)
    assert not np.array_equal(first.q, solver.solve(target, rng=1).q)
    generators = np.random.default_rng(1), np.random.default_rng(1)
    assert np.array_equal(*(solver.solve(target, rng=g).q for g in generators))
    assert not np.array_equal(first.q, solver.solve(target, rng=generators[0]).q)


def test_arguments_are_not_touched(maira, rng):
    T, q0 = maira.forward(maira.random_configuration(rng)).homogeneous, maira.random_configuration(rng)
    before = T.copy(), q0.copy()
    s = mq.Solver(maira).solve(T, q0=q0)
    s.q[:] = 0.0  # the caller's own
    assert np.array_equal(T, before[0])
    assert np.array_equal(q0, before[1])


@pytest.mark.parametrize("backend", ["compiled", "daqp"])
@pytest.mark.parametrize("redundancy", [None, mq.Strict(mq.Posture())], ids=["none", "strict"])
def test_a_batch_is_its_targets_one_by_one_whatever_the_order_or_the_split(maira, backend, redundancy, rng):
    targets = np.array([maira.forward(maira.random_configuration(rng)).homogeneous for _ in range(12)])
    solver = mq.Solver(maira, backend=backend, redundancy=redundancy)
    batch = solver.solve_batch(targets, seed=7)
    assert len(batch) == 12
    assert batch.q.shape == (12, 7)
    assert batch.success.all()
    assert (batch.status == int(mq.Status.CONVERGED)).all()
    for i in (0, 5, 11):
        alone = solver.solve(targets[i], rng=7)
        for f in fields(mq.Solution):
            if f.name.startswith("_"):
                continue
            values = getattr(batch[i], f.name), getattr(alone, f.name)
            if f.name.endswith("_error"):  # evaluated by the kernel and by Pinocchio
                assert values[0] == pytest.approx(values[1], abs=1e-14)
            elif f.name == "condition_number":
                assert values[0] == pytest.approx(values[1], rel=1e-9)
            else:
                assert np.array_equal(*values, equal_nan=f.name in ("cost", "projected_gradient")), f.name
    order = rng.permutation(12)
    assert np.array_equal(solver.solve_batch(targets[order], seed=7).q, batch.q[order])
    assert np.array_equal(solver.solve_batch(targets[4:9], seed=7).q, batch.q[4:9])
    if redundancy is None or backend != "compiled":  # else all begin near the best posture
        assert not np.array_equal(solver.solve_batch(targets, seed=8).q, batch.q)
    assert [s.q.tolist() for s in batch] == batch.q.tolist()


def test_no_answer_depends_on_the_number_of_threads(maira, rng):
    targets = [maira.forward(maira.random_configuration(rng)) for _ in range(700)]
    one, three = (mq.Solver(maira).solve_batch(targets, threads=threads) for threads in (1, 3))
    assert one.success.all()
    for name in (
        *(f.name for f in fields(mq.BatchSolution) if not f.name.startswith("_")),
        "condition_number",
        "active_limits",
    ):
        values = getattr(one, name), getattr(three, name)
        assert values[0] == values[1] if isinstance(values[0], (list, str)) else np.array_equal(*values, equal_nan=True)
    assert all(pose_error(maira, q, T) <= 1.01e-6 and inside(maira, q) for q, T in zip(one.q, targets, strict=True))


def test_a_batch_takes_starts_for_all_or_for_each(maira, rng):
    starts = np.array([maira.random_configuration(rng) for _ in range(3)])
    targets = [maira.forward(q) for q in starts]
    assert np.array_equal(mq.Solver(maira).solve_batch(targets, q0=starts).q, starts)
    assert mq.Solver(maira).solve_batch(targets, q0=starts[0]).success.all()


@pytest.mark.parametrize("backend", ["compiled", "daqp"])
def test_a_target_with_nan_spoils_only_its_own_row(maira, backend, rng):
    targets = np.array([maira.forward(maira.random_configuration(rng)).homogeneous for _ in range(5)])
    solver = mq.Solver(maira, backend=backend)
    whole = solver.solve_batch(targets)
    targets[1, 0, 3], targets[3] = np.nan, np.inf
    batch = solver.solve_batch(targets)
    assert batch.success.tolist() == [True, False, True, False, True]
    assert batch.status.tolist() == [0, 4, 0, 4, 0]
    assert np.array_equal(batch.q[::2], whole.q[::2])
    assert np.isnan(batch.position_error[[1, 3]]).all()
    assert np.isnan(batch.orientation_error[[1, 3]]).all()
    assert all(inside(maira, q) for q in batch.q[::2])
    assert np.isnan(batch.q[[1, 3]]).all()
    assert np.isnan(batch.condition_number[[1, 3]]).all()
    with pytest.raises(PoseError, match="finite"):
        solver.solve(targets[1])


@pytest.mark.parametrize("threads", [1, 3])
def test_progress_is_told_in_order_by_the_calling_thread_to_the_end(maira, threads, rng):
    targets, told = (
        np.tile([maira.forward(maira.random_configuration(rng)).homogeneous for _ in range(6)], (500, 1, 1)),
        [],
    )

    def progress(done, total):
        told.append((done, total, threading.get_ident()))

    mq.Solver(maira).solve_batch(targets, threads=threads, progress=progress)
    assert [done for done, _, _ in told] == sorted({done for done, _, _ in told})
    assert len(told) >= (2 if threads == 1 else 1)
    assert told[-1][:2] == (3000, 3000)
    assert {ident for _, _, ident in told} == {threading.get_ident()}


@pytest.mark.parametrize("settings", [{"backend": "daqp"}, {"redundancy": mq.Strict(mq.Manipulability())}], ids=str)
def test_progress_is_told_of_what_the_general_engine_finishes(maira, settings, rng):
    targets, told = np.array([maira.forward(maira.random_configuration(rng)).homogeneous for _ in range(4)]), []
    targets[3] = np.nan
    mq.Solver(maira, **settings).solve_batch(targets, progress=lambda done, total: told.append((done, total)))
    assert told == [(1, 4), (2, 4), (3, 4), (4, 4)]


def test_an_interrupt_from_the_progress_callback_stops_a_batch(maira, rng):
    targets = [maira.forward(maira.random_configuration(rng)) for _ in range(2000)]

    def progress(done, total):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        mq.Solver(maira).solve_batch(targets, threads=2, progress=progress)


def test_a_part_of_a_batch_is_a_batch_and_a_pickle_needs_no_robot(maira, rng):
    q = np.array([maira.upper, maira.random_configuration(rng), maira.lower])
    batch = mq.Solver(maira).solve_batch([maira.forward(each) for each in q], q)
    part, copy, one = batch[1:], pickle.loads(pickle.dumps(batch)), pickle.loads(pickle.dumps(batch[0]))
    assert isinstance(part, mq.BatchSolution)
    assert np.array_equal(part.q, batch.q[1:])
    assert np.array_equal(part.condition_number, batch.condition_number[1:])
    assert copy.active_limits == batch.active_limits == [s.active_limits for s in batch]
    assert np.array_equal(copy.condition_number, batch.condition_number)
    assert [name.split()[0] for name in one.active_limits] == list(maira.joint_names)
    assert one.condition_number == pytest.approx(maira.condition_number(one.q), rel=1e-9)
    assert len(pickle.dumps(batch[0])) < 2000


def test_starts_far_beyond_a_turn_are_left_to_the_general_engine(rng):
    """There the sine of the kernels loses digits."""
    robot = load("pr2_arm")
    turns = np.isinf(robot.upper)
    assert turns.any()
    q = robot.random_configuration(rng)
    start = np.where(turns, q + 2e5 * np.pi, q)
    for s in (
        mq.Solver(robot).solve(robot.forward(q), q0=start),
        mq.Solver(robot).solve_batch([robot.forward(q)], q0=start)[0],
    ):
        assert s.success
        assert pose_error(robot, s.q, robot.forward(q)) <= 1.01e-6
        assert (s.q[turns] > 1e5).all()


def test_an_empty_batch_has_empty_fields(maira):
    batch = mq.Solver(maira).solve_batch(np.empty((0, 4, 4)))
    assert len(batch) == 0
    assert batch.q.shape == (0, 7)
    assert batch.success.dtype == bool
    with pytest.raises(IndexError):
        batch[0]


def test_threads_may_share_a_solver(maira, rng):
    targets = [maira.forward(maira.random_configuration(rng)) for _ in range(24)]
    solver = mq.Solver(maira, redundancy=mq.Strict(mq.Posture()))
    alone = [solver.solve(T, rng=k).q for k, T in enumerate(targets)]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(lambda k: solver.solve(targets[k], rng=k).q, range(24)))
    assert np.array_equal(alone, together)


def test_everything_public_pickles(maira, rng):
    target = maira.forward(maira.random_configuration(rng))
    solver = mq.Solver(maira, redundancy=mq.Strict(mq.Manipulability(), mq.Posture()), backend="osqp")
    again = pickle.loads(pickle.dumps(solver))
    one, two = solver.solve(target), pickle.loads(pickle.dumps(again.solve(target)))
    assert np.array_equal(one.q, two.q)
    assert two.status is mq.Status.CONVERGED
    batch = pickle.loads(pickle.dumps(solver.solve_batch([target])))
    assert np.array_equal(batch[0].q, batch.q[0])
    for thing in (
        mq.Options(),
        mq.LimitDistance(),
        mq.ObstacleDistance([0, 0, 0]),
        mq.PoseTask(),
        mq.LinearLimit([[1.0]], [1.0]),
    ):
        assert type(pickle.loads(pickle.dumps(thing))) is type(thing)


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda s: s.solve(np.zeros((4, 4))), PoseError, "last row"),
        (lambda s: s.solve(np.full((4, 4), np.nan)), PoseError, "finite"),
        (lambda s: s.solve(np.eye(3)), PoseError, "shape"),
        (lambda s: s.solve("target"), PoseError, "target must be a pose .*, not str"),
        (lambda s: s.solve({"hand": np.eye(4)}), FrameError, "tool0"),
        (lambda s: s.solve({}), PoseError, "'tool0' is missing"),
        (lambda s: s.solve(), PoseError, "need a target"),
        (lambda s: s.solve(np.diag([1.0, 1, -1, 1])), PoseError, "reflection"),
        (lambda s: s.solve(np.eye(4), q0=np.zeros(6)), ConfigurationError, r"shape \(7,\)"),
        (lambda s: s.solve(np.eye(4), q0=[np.nan] * 7), ConfigurationError, "finite"),
        (lambda s: s.solve(np.eye(4), q0=[1j] * 7), ConfigurationError, "real numbers"),
        (lambda s: s.solve(np.eye(4), rng="seed"), OptionError, "rng"),
        (lambda s: s.solve(np.eye(4), rng=-1), OptionError, "rng"),
        (lambda s: s.solve_batch(np.eye(4)), PoseError, "for one target use solve"),
        (lambda s: s.solve_batch(mq.pose([0, 0, 0])), PoseError, "sequence"),
        (lambda s: s.solve_batch([np.eye(4), 2 * np.eye(4)]), PoseError, "target 1"),
        (lambda s: s.solve_batch([np.eye(4)] * 2, q0=np.zeros((3, 7))), ConfigurationError, r"shape \(2, 7\)"),
        (lambda s: s.solve_batch([np.eye(4)], seed=-1), OptionError, "seed"),
        (lambda s: s.solve_batch([np.eye(4)], seed=0.5), OptionError, "seed"),
        (lambda s: s.solve(FAR), PoseError, "away"),
        (lambda s: s.solve_batch([np.eye(4), FAR]), PoseError, "target 1"),
        (lambda s: s.step(np.zeros(7), FAR, 0.1), PoseError, "away"),
        (lambda s: s.step(np.full(7, np.nan), np.eye(4), 0.1), ConfigurationError, "finite"),
        (lambda s: s.step(np.zeros(7), np.diag([1.0, 1, -1, 1]), 0.1), PoseError, "reflection"),
        (lambda s: s.step(np.zeros(7), np.eye(4), 0), OptionError, "dt"),
        (lambda s: s.step(np.zeros(7), np.eye(4), np.nan), OptionError, "dt"),
        (lambda s: s.step(np.zeros(5), np.eye(4), 0.1), ConfigurationError, r"shape \(7,\)"),
    ],
)
def test_what_cannot_be_meant_is_refused_with_a_reason(maira, call, error, message):
    with pytest.raises(error, match=message):
        call(mq.Solver(maira))


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"backend": "gurobi2"}, BackendError, "valid names: .*daqp"),
        ({"options": {"max_restarts": 3}}, OptionError, "Options"),
        ({"redundancy": mq.Posture()}, OptionError, r"Strict\(mq.Posture"),
        ({"task": []}, OptionError, "first level"),
        ({"tasks": [mq.ObjectiveTask(mq.Posture())], "redundancy": mq.Weighted(mq.Posture())}, OptionError, "Weighted"),
        ({"tasks": [mq.PoseTask(frame="hand", target=np.eye(4))]}, FrameError, "tool0"),
        ({"task": "pose"}, OptionError, "PoseTask"),
        ({"tasks": mq.PoseTask(target=np.eye(4))}, OptionError, "a list"),
        ({"limits": mq.LinearLimit(np.eye(7), np.ones(7))}, OptionError, "a list"),
        ({"limits": [3]}, OptionError, "LinearLimit"),
        ({"limits": [mq.LinearLimit(np.eye(6), np.ones(6))]}, OptionError, "7 columns"),
    ],
)
def test_a_solver_checks_what_it_is_made_of(maira, arguments, error, message):
    with pytest.raises(error, match=message):
        mq.Solver(maira, **arguments)
    with pytest.raises(OptionError, match="Robot"):
        mq.Solver("maira", **{})


@pytest.mark.parametrize("field", [f.name for f in fields(mq.Options)])
@pytest.mark.parametrize("value", [-1, np.nan, np.inf, "1", True, 0.5j])
def test_options_out_of_range_are_refused_by_name(field, value):
    with pytest.raises(OptionError, match=field):
        mq.Options(**{field: value})


def test_options_know_their_ranges():
    with pytest.raises(OptionError, match="stall_ratio"):
        mq.Options(stall_ratio=1.0)
    with pytest.raises(OptionError, match="max_iterations"):
        mq.Options(max_iterations=2.5)
    with pytest.raises(TypeError):
        mq.Options(1e-3)
    assert mq.Options(max_restarts=0).max_restarts == 0
    taken = mq.Options(max_iterations=2.0, max_restarts=np.int64(3), damping=np.float32(0.5))
    assert [type(x) for x in (taken.max_iterations, taken.max_restarts, taken.damping)] == [int, int, float]
