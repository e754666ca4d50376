"""dq/dtarget: every kind of answer against differences of answers at moved targets."""

import pickle
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from support.compiled_problems import arm
from support.derivatives import assert_close, difference_gradient, difference_jacobian

import maira_qp as mq
from maira_qp.errors import SensitivityError

EXACT = mq.Options(position_tolerance=1e-10, orientation_tolerance=1e-10, stationarity_tolerance=1e-10)
TRADE_OFF = mq.Options(stationarity_tolerance=1e-8)

five_robots = pytest.mark.parametrize("name", ["maira", "iiwa14_urdf", "panda", "ur5", "xarm7"])

WISHES = {
    "posture": (mq.Strict(mq.Posture()), None, EXACT),
    "limit distance": (mq.Strict(mq.LimitDistance()), None, EXACT),
    "weighted 1e-3": (mq.Weighted(mq.Posture(), weight=1e-3), None, TRADE_OFF),
    "weighted 1": (mq.Weighted(mq.Posture(), weight=1.0), None, TRADE_OFF),
    "position": (mq.Strict(mq.Posture()), mq.PositionTask(), EXACT),
}


def moved(target: pin.SE3, twist: np.ndarray) -> pin.SE3:
    return pin.SE3(pin.exp3(twist[3:]) @ target.rotation, target.translation + twist[:3])


def by_differences(solver: mq.Solver, target: pin.SE3, q: np.ndarray, step: float = 1e-4) -> np.ndarray | None:
    """dq/dtarget (n, 6) by solving again at moved targets: central differences of the fourth order.

    None if one is not optimal, or is another optimum far away, or stands on other limits: there the answer has a kink.
    """
    rows, limits = [], None
    for twist in step * np.eye(6):
        answers = []
        for k in (1, -1, 2, -2):
            s = solver.solve(moved(target, k * twist), q0=q)
            limits = s.active_limits if limits is None else limits
            if not s.optimal or np.abs(s.q - q).max() > 50 * step or s.active_limits != limits:
                return None
            answers.append(s.q)
        rows.append((8 * (answers[0] - answers[1]) - (answers[2] - answers[3])) / (12 * step))
    return np.array(rows).T


def regular(solver: mq.Solver, rng: np.random.Generator, least_active: int = 0):
    """Targets and answers whose derivative is moderate, so that differences tell it; with limits active if asked."""
    robot = solver.robot
    for _ in range(200):
        target = robot.forward(robot.random_configuration(rng))
        s = solver.solve(target)
        regular = s.optimal and s.condition_number < 15 and len(s.active_limits) >= least_active
        if regular and np.abs(s.jacobian()).max() < 8:
            yield target, s


def stationary(robot: mq.Robot, target: pin.SE3, q: np.ndarray, posture: mq.Posture | None = None, weight: float = 0):
    """The stationary point (n,) of `1/2 |W e|^2 + weight posture` near q: Newton's method by differences, least steps.

    The joints that stand on limits are held there.
    """
    free, W2 = (q > robot.lower) & (q < robot.upper), np.repeat([(4 / robot.length) ** 2, 1.0], 3)

    def gradient(x: np.ndarray) -> np.ndarray:
        y = q.copy()
        y[free] = x
        g = -robot.jacobian(y).T @ (W2 * mq.pose_error(robot.forward(y), target))
        return (g if posture is None else g + weight * posture.gradient(robot.at(y)))[free]

    x = q[free]
    for _ in range(6):
        x = x - np.linalg.pinv(difference_jacobian(gradient, x, 1e-5), rcond=1e-6) @ gradient(x)
    y = q.copy()
    y[free] = x
    return y


def differences_of_stationary(robot: mq.Robot, target: pin.SE3, q: np.ndarray, *wish) -> np.ndarray | None:
    """dq/dtarget (n, 6) of `stationary`; None if q is not that itself."""
    centre = stationary(robot, target, q, *wish)
    if np.abs(centre - q).max() > 1e-6:
        return None
    return difference_jacobian(lambda t: stationary(robot, moved(target, t), centre, *wish), np.zeros(6), 1e-4)


def check(solver: mq.Solver, rng: np.random.Generator, count: int, least_active: int = 0) -> None:
    """The derivatives of so many answers are those of differences."""
    checked, wish = 0, solver.redundancy
    for target, s in regular(solver, rng, least_active):
        if isinstance(wish, mq.Weighted):  # its optimum by re-solving is too coarse
            differences = differences_of_stationary(solver.robot, target, s.q, wish.objective, wish.weight)
        else:
            differences = by_differences(solver, target, s.q)
        if differences is not None:
            assert_close(s.jacobian(), differences, 1e-5)
            checked += 1
        if checked == count:
            return
    raise AssertionError(f"only {checked} answers could be checked")


@five_robots
@pytest.mark.parametrize("wish", WISHES)
def test_the_derivative_is_that_of_the_answers(name, wish, rng):
    redundancy, task, options = WISHES[wish]
    solver = mq.Solver(arm(name), task=task, redundancy=redundancy, options=options)
    assert solver.backend == "compiled"
    check(solver, rng, 2)


@pytest.mark.parametrize("name", ["panda", "ur5"])
@pytest.mark.parametrize("wish", ["posture", "position"])
def test_the_general_engine_has_the_same_derivative(name, wish, rng):
    redundancy, task, options = WISHES[wish]
    compiled, general = (
        mq.Solver(arm(name), task=task, redundancy=redundancy, options=options, backend=backend)
        for backend in (None, "daqp")
    )
    target, s = next(regular(compiled, rng))
    assert_close(general.solve(target, q0=s.q).jacobian(), s.jacobian(), 1e-7)
    check(general, rng, 1)


@pytest.mark.parametrize("objective", [mq.Manipulability(), mq.ObstacleDistance([0.3, 0.2, 0.5])])
def test_objectives_of_the_general_engine(panda, objective, rng):
    """Their own Hessians are differences, too."""
    check(mq.Solver(panda, redundancy=mq.Strict(objective), options=mq.Options(stationarity_tolerance=1e-8)), rng, 1)


@pytest.mark.parametrize("name", ["maira", "iiwa14_urdf", "panda", "xarm7", "tiago"])
@pytest.mark.parametrize("kind", ["strict", "position", "weighted"])
def test_a_joint_that_a_limit_holds_does_not_move(name, kind, rng):
    """The reference lies beyond the limits of some joints, which end on them; the other joints bend around that."""
    robot = arm(name).limited(margin=0.1)
    beyond = mq.Posture(np.where(np.arange(robot.n) % 3 == 2, robot.upper + 1.0, robot.middle))
    solver = mq.Solver(
        robot,
        task=mq.PositionTask() if kind == "position" else None,
        redundancy=mq.Weighted(beyond, weight=0.1) if kind == "weighted" else mq.Strict(beyond),
        options=TRADE_OFF if kind == "weighted" else EXACT,
    )
    for _, (_, s) in zip(range(3), regular(solver, rng, least_active=1), strict=False):
        J, held = s.jacobian(), (s.q == robot.lower) | (s.q == robot.upper)
        assert held.any()
        assert not J[held].any()
        assert np.abs(J[~held]).max() > 0.1
    check(solver, rng, 1, least_active=1)


@pytest.mark.parametrize(
    "task",
    [
        mq.OrientationTask(),
        mq.PoseTask(axes="target", position_weight=[1, 2, 3], orientation_weight=[1, 2, 0]),
        mq.PoseTask(position_weight=[1, 0, 3], orientation_weight=[3, 2, 1]),
    ],
)
@pytest.mark.parametrize("name", ["maira", "panda", "ur5"])
def test_parts_of_a_pose_and_axes_that_count_differently(name, task, rng):
    check(mq.Solver(arm(name), task=task, redundancy=mq.Strict(mq.Posture()), options=EXACT), rng, 1)


def test_a_second_task_whose_target_stands_still_is_kept(rng):
    """The tool on its pose, the elbow's height fixed: eight joints, all seven rows are met and stay met."""
    robot = arm("tiago")
    elbow = robot.moved_links[4]
    target, s = next(regular(mq.Solver(robot), rng))
    fixed = mq.PositionTask(frame=elbow, target=robot.forward(s.q, elbow), position_weight=[0, 0, 1])
    both = mq.Solver(robot, task=[mq.PoseTask(), fixed], redundancy=mq.Strict(mq.Posture()))
    t = both.solve(target, q0=s.q)
    assert t.optimal
    J = t.jacobian()
    assert_close(robot.jacobian(t.q) @ J, np.eye(6), 1e-6)
    assert np.abs(robot.jacobian(t.q, elbow)[2] @ J).max() < 1e-6


@pytest.mark.parametrize(
    "task",
    [
        mq.PoseTask(position_weight=[1, 2, 3], orientation_weight=[2, 2, 2]),
        mq.PoseTask(axes="target", position_weight=[1, 0, 3], orientation_weight=[1, 2, 0.5]),
        mq.OrientationTask(orientation_weight=[1, 0, 2]),
        mq.OrientationTask(axes="target", orientation_weight=[0, 0, 1]),
    ],
)
@pytest.mark.parametrize("angle", [0.0, 1e-5, 0.05, 0.15, 1.0, 2.8])
def test_a_task_knows_its_second_derivatives_at_any_error(panda, task, angle, rng):
    """By the joints and by the target, of the rows and of the cost, near zero error and far from it."""
    q, turn = panda.random_configuration(rng), rng.normal(size=3)
    error = np.r_[angle * rng.normal(size=3), angle * turn / np.linalg.norm(turn)]
    task = replace(task.of(panda), target=moved(panda.forward(q), error))
    y, at = rng.normal(size=len(task.weights)), panda.at(q)

    def toward(twist: np.ndarray):
        return replace(task, target=moved(task.target, twist))

    def gradient(value, goal, q: np.ndarray) -> np.ndarray:
        near, far = (difference_gradient(lambda x: value(goal.weighted_error(panda.at(x))), q, h) for h in (2e-3, 4e-3))
        return (4 * near - far) / 3

    assert_close(task.target_jacobian(at), difference_jacobian(lambda t: toward(t).error(at), np.zeros(6)), 1e-8)
    for value, H, B in (
        (lambda r: -y @ r, task.error_curvature(at, y), task.target_curvature(at, y)),
        (lambda r: 0.5 * r @ r, task.hessian(at), task.target_hessian(at)),
    ):
        by_q = difference_jacobian(lambda x: gradient(value, task, x), q, 1e-4)  # noqa: B023
        by_target = difference_jacobian(lambda t: gradient(value, toward(t), q), np.zeros(6), 1e-4)  # noqa: B023
        assert_close(H, by_q, 1e-6)
        assert_close(B, by_target, 1e-6)
    bend = difference_jacobian(lambda x: y @ task.rows(panda.at(x))[0], q, 1e-4)
    assert_close(task.curvature(at, y), 0.5 * (bend + bend.T), 1e-6)


@five_robots
def test_the_nearest_point_of_a_target_out_of_reach(name, rng):
    """Also where a self-motion leaves it open: a straight S-R-S arm turns about itself, and follows by the least."""
    robot, checked = arm(name), 0
    solver = mq.Solver(robot, options=mq.Options(max_restarts=3))
    for _ in range(40):
        target = robot.forward(robot.random_configuration(rng))
        target.translation *= 1.0 + 0.5 * robot.length / np.linalg.norm(target.translation)
        s = solver.solve(target)
        differences = differences_of_stationary(robot, target, s.q)
        if s.optimal and not s.success and differences is not None and np.abs(differences).max() < 10:
            assert_close(s.jacobian(), differences, 1e-5)
            checked += 1
        if checked == 2:
            return
    raise AssertionError(f"only {checked} answers could be checked")


def test_without_a_redundancy_a_regular_arm_has_the_inverse(ur5, maira, rng):
    for robot, inverse in ((ur5, np.linalg.inv), (maira, lambda J: np.linalg.pinv(J))):
        _, s = next(regular(mq.Solver(robot), rng))
        assert_close(s.jacobian(), inverse(robot.jacobian(s.q)), 1e-6)


def test_an_arm_with_few_joints_follows_as_near_as_it_can(rng):
    """Five joints and six rows: the derivative of the nearest point, at a target that is reached."""
    links = [
        mq.DHLink(d=0.3, alpha=np.pi / 2),
        mq.DHLink(a=0.4),
        mq.DHLink(a=0.3, alpha=0.4),
        mq.DHLink(d=0.2, alpha=1),
    ]
    robot = mq.Robot.from_dh([*links, mq.DHLink(a=0.1)])
    q = np.array([0.3, 0.5, 0.9, -0.4, 0.2])
    s = mq.Solver(robot).solve(robot.forward(q), q0=q)
    assert_close(s.jacobian(), differences_of_stationary(robot, robot.forward(q), s.q), 1e-5)


def test_a_limit_without_a_multiplier_holds_nothing(panda):
    """The optimum lies just on a limit: the derivative is that with wider limits."""
    q = np.array([0.2, 0.3, 0.1, -1.6, 0.3, 1.8, 0.4])
    for objective in (mq.Strict(mq.Posture(q)), mq.Weighted(mq.Posture(q), weight=0.1)):
        near, wide = (
            mq.Solver(robot, redundancy=objective).solve(panda.forward(q), q0=q)
            for robot in (panda.limited(upper={"panda_joint2": 0.3}), panda)
        )
        assert near.active_limits == ["panda_joint2 upper"]
        assert np.abs(near.jacobian()[1]).max() > 0.1
        assert_close(near.jacobian(), wide.jacobian(), 1e-6)


def test_a_batch_has_the_derivatives_of_its_solutions(maira, rng):
    """Whatever the caller does with the targets later, and in slices too."""
    targets = np.array([maira.forward(maira.random_configuration(rng)).homogeneous for _ in range(4)])
    for redundancy in (None, mq.Strict(mq.Posture()), mq.Strict(mq.Manipulability())):
        solver = mq.Solver(maira, redundancy=redundancy)
        given = targets.copy()
        single = [solver.solve(T) for T in given]
        batch = solver.solve_batch(given)
        expected = [solver.solve(pin.SE3(T)).jacobian() for T in targets]
        given[:] = np.eye(4)
        for i in range(4):
            for s in (single[i], batch[i], batch[-4:][i - 4], batch[i:][0]):
                np.testing.assert_allclose(s.jacobian(), expected[i], atol=1e-9, rtol=1e-6)


@pytest.mark.parametrize("redundancy", [None, mq.Strict(mq.Posture())])
def test_singular_poses_have_no_derivative(maira, ur5, redundancy):
    """A straight arm, and one whose wrist is straight, solved from there and from elsewhere."""
    for robot, q in (
        (maira, np.zeros(7)),
        (maira, [0.3, 0.8, 0.2, 0, 0.4, 0.7, 0.1]),
        (ur5, [0.3, -1, 1.2, 0.4, 0, 0]),
    ):
        for q0 in (q, None):
            s = mq.Solver(robot, redundancy=redundancy).solve(robot.forward(q), q0=q0)
            if np.linalg.svd(robot.jacobian(s.q), compute_uv=False)[-1] < 1e-3:
                with pytest.raises(SensitivityError, match=r"singular|optimal"):
                    s.jacobian()
            else:
                assert q0 is None  # another way to reach it


def test_an_objective_that_does_not_choose_has_no_derivative(maira, rng):
    blind = mq.Posture(weights=0.0)
    s = mq.Solver(maira, redundancy=mq.Strict(blind)).solve(maira.forward(maira.random_configuration(rng)))
    with pytest.raises(SensitivityError, match="does not curve"):
        s.jacobian()


def test_a_joint_on_a_limit_that_the_target_needs(ur5):
    """Six joints, six rows, and a joint that cannot move to one side."""
    q = np.array([0.3, -1.0, 1.2, 0.4, 0.9, 0.2])
    s = mq.Solver(ur5.limited(upper={"elbow_joint": 1.2})).solve(ur5.forward(q), q0=q)
    assert s.active_limits == ["elbow_joint upper"]
    with pytest.raises(SensitivityError, match="limits hold"):
        s.jacobian()


def test_what_has_no_derivative_says_why(maira, rng):
    """Answers that are not optimal, that were pickled, and problems of other kinds."""
    target = maira.forward(maira.random_configuration(rng))
    solver = mq.Solver(maira)
    s = solver.solve(target)
    with pytest.raises(SensitivityError, match="pickled"):
        pickle.loads(pickle.dumps(s)).jacobian()
    with pytest.raises(SensitivityError, match="pickled"):
        pickle.loads(pickle.dumps(solver.solve_batch([target])))[0].jacobian()
    hasty = mq.Solver(maira, options=mq.Options(max_restarts=0, max_iterations=1, max_settling=0))
    with pytest.raises(SensitivityError, match="BUDGET_SPENT"):
        hasty.solve(target, q0=maira.upper).jacobian()
    lower = mq.Solver(maira, task=mq.PositionTask(), tasks=[mq.OrientationTask(priority=2)])
    other = mq.Solver(maira, task=mq.AxisTask())
    for solver, reason in ((lower, "lower levels"), (other, "PoseTask, PositionTask")):
        with pytest.raises(SensitivityError, match=reason):
            solver.solve(target, q0=s.q).jacobian()
    with pytest.raises(SensitivityError, match="one target"):
        mq.Solver(maira, task=mq.PositionTask(target=target)).solve(q0=s.q).jacobian()
    tight = mq.LinearLimit(np.eye(7)[:1], [s.q[0]])
    with pytest.raises(SensitivityError, match="further limits"):
        mq.Solver(maira, limits=[tight]).solve(target, q0=s.q).jacobian()
    wide = mq.LinearLimit(np.eye(7)[:1], [s.q[0] + 1])
    assert_close(mq.Solver(maira, limits=[wide]).solve(target, q0=s.q).jacobian(), s.jacobian(), 1e-6)
