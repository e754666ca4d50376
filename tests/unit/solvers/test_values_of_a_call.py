"""What a call may say by name: targets of any task, weights, what is switched off; as a solver that is built for it."""

import dataclasses
import pickle

import numpy as np
import pinocchio as pin
import pytest

import maira_qp as mq
from maira_qp.errors import FrameError, OptionError, PoseError

DT = 0.01
ELBOW = {"shoulder": "link2", "elbow": "link4", "wrist": "link6"}
POSE = pin.SE3(pin.exp3(np.array([0.3, -0.4, 0.5])), np.array([0.4, 0.1, 0.9]))


@pytest.fixture
def q(maira):
    return maira.random_configuration(np.random.default_rng(5))


@pytest.fixture
def other(maira):
    return maira.random_configuration(np.random.default_rng(6))


def parts(robot: mq.Robot, q: np.ndarray) -> dict:
    """Parts with a datum of the solver's own, made from any datum; a datum for the solver, and another for a call."""
    coefficients = {"joint1": 1.0, "joint3": -1.0}
    return {
        "target": (lambda T: mq.PoseTask(frame="link5", target=T, priority=2), robot.forward(q, "link5"), POSE),
        "point": (lambda p: mq.LookAtTask(frame="link5", point=p, priority=2), [0.3, 0.9, 0.2], [1.0, 0.2, 0.3]),
        "direction": (lambda d: mq.AxisTask(frame="link5", direction=d, priority=2), [0, 0, 1], [0.3, 1, 0]),
        "relative": (
            lambda T: mq.RelativePoseTask(frame="link6", reference="link3", target=T, priority=2),
            robot.forward(q, "link3").actInv(robot.forward(q, "link6")),
            POSE,
        ),
        "swivel": (lambda psi: mq.SwivelTask(**ELBOW, angle=psi), 0.3, -2.0),
        "coupling": (lambda v: mq.JointCouplingTask(coefficients=coefficients, value=v, priority=2), 1.5, 1.0),
        "posture": (lambda q_ref: mq.ObjectiveTask(mq.Posture(q_ref), priority=2), robot.middle, q),
        "obstacle": (lambda p: mq.ObjectiveTask(mq.ObstacleDistance(p), priority=2), [1, 0, 0.5], [0.4, 0.4, 0.4]),
    }


KEYS = {
    "target": "link5",
    "point": "link5",
    "direction": "link5",
    "relative": "link6",
    "swivel": "swivel",
    "coupling": "joint_coupling",
    "posture": "posture",
    "obstacle": "obstacle_distance",
}


@pytest.mark.parametrize("backend", [None, "daqp"])
@pytest.mark.parametrize("kind", KEYS)
def test_a_tick_with_another_datum_is_that_of_a_solver_that_is_built_with_it(maira, q, other, kind, backend):
    made_of, own, given = parts(maira, other)[kind]
    wish = mq.Strict(mq.Posture(name="rest"))
    solver, built = (
        mq.Solver(maira, task=mq.PositionTask(), tasks=[made_of(datum)], redundancy=wish, backend=backend)
        for datum in (own, given)
    )
    T = maira.forward(maira.clip(q + 1e-3))
    called, asked = solver.step(q, {"tool0": T, KEYS[kind]: given}, 1.0), built.step(q, T, 1.0)
    assert called.backend == asked.backend
    np.testing.assert_allclose(called.q, asked.q, rtol=0, atol=1e-12)
    assert np.abs(called.q - solver.step(q, T, 1.0).q).max() > 1e-6, "the datum changed nothing"
    np.testing.assert_array_equal(solver.step(q, T, DT).q, solver.step(q, {"tool0": T}, DT).q)


@pytest.mark.parametrize("kind", ["point", "swivel", "posture"])
def test_a_solve_with_another_datum_is_that_of_a_solver_that_is_built_with_it(maira, q, other, kind):
    made_of, own, given = parts(maira, other)[kind]
    solver, built = (mq.Solver(maira, tasks=[made_of(datum)]) for datum in (own, given))
    T = maira.forward(maira.clip(q + 0.1))
    called, asked = solver.solve({"tool0": T, KEYS[kind]: given}, q), built.solve(T, q)
    assert called.success == asked.success
    np.testing.assert_allclose(called.q, asked.q, rtol=0, atol=1e-9)
    assert "reached" in str(called.explain())


@pytest.mark.parametrize("wish", [mq.Strict, lambda posture: mq.Weighted(posture, 1e-2)])
@pytest.mark.parametrize("start", [False, True])
def test_a_compiled_solve_with_a_moved_posture_stays_compiled_and_is_that_of_its_own_solver(
    maira, q, other, wish, start
):
    solver, built = (
        mq.Solver(maira, redundancy=wish(mq.Posture())),
        mq.Solver(maira, redundancy=wish(mq.Posture(other))),
    )
    T, q0 = maira.forward(maira.clip(q + 0.1)), q if start else None
    called, asked = solver.solve({"tool0": T, "posture": other}, q0), built.solve(T, q0)
    assert called.backend == asked.backend == "compiled"
    np.testing.assert_allclose(called.q, asked.q, rtol=0, atol=1e-9)
    assert called.cost == pytest.approx(asked.cost, abs=1e-12)
    np.testing.assert_allclose(called.jacobian(), asked.jacobian(), atol=1e-9)
    assert np.abs(called.q - solver.solve(T, q0).q).max() > 1e-4


def test_a_posture_of_a_call_is_given_by_name():
    """Joints that are not named keep the reference that the solver was built with."""
    robot = mq.Robot.maira()
    built = robot.middle + 0.2
    solver, T = mq.Solver(robot, redundancy=mq.Strict(mq.Posture(built))), robot.forward(robot.middle + 0.1)
    other = built.copy()
    other[2] = -0.4
    by_name = solver.solve({"tool0": T, "posture": {"joint3": -0.4}})
    np.testing.assert_array_equal(by_name.q, solver.solve({"tool0": T, "posture": other}).q)
    assert np.abs(by_name.q - solver.solve(T).q).max() > 1e-3
    with pytest.raises(OptionError, match="reference of 'posture': 'elbow' is not a joint"):
        solver.solve({"tool0": T, "posture": {"elbow": 0.1}})


def test_joints_of_more_than_a_turn_end_at_the_turn_nearest_to_the_posture_of_the_call():
    twists, lengths, offsets = (0, -np.pi / 2, 0, np.pi / 2, -np.pi / 2, np.pi / 2), (0, 0, 0.4, 0, 0, 0), (0.3,) * 6
    links = [
        mq.DHLink(kind="revolute", a=a, alpha=alpha, d=d, theta=0, lower=-7, upper=7)
        for a, alpha, d in zip(lengths, twists, offsets, strict=True)
    ]
    robot = mq.Robot.from_dh(links, name="turning")
    q, far = np.array([0.3, -0.5, 0.7, 0.4, 0.6, -0.2]), np.full(6, 5.5)
    solver, built = (mq.Solver(robot, redundancy=mq.Strict(mq.Posture(ref))) for ref in (None, far))
    T, (key, _) = robot.forward(q), solver.names
    called = solver.solve({key: T, "posture": far})
    np.testing.assert_allclose(called.q, built.solve(T).q, rtol=0, atol=1e-9)
    assert np.abs(called.q - solver.solve(T).q).max() > 3.0


@pytest.mark.parametrize("backend", [None, "daqp"])
def test_weights_are_multiplied_for_one_call(maira, q, other, backend):
    def tasks(position, gaze, posture):
        return [
            mq.PositionTask(position_weight=position),
            mq.OrientationTask(name="attitude"),
            mq.LookAtTask(frame="link5", point=[1, 1, 1], weight=gaze, name="gaze"),
            mq.ObjectiveTask(mq.Posture(other), posture),
        ]

    solver, built = (
        mq.Solver(maira, task=tasks(*each), backend=backend) for each in ((2.0, 1.0, 0.3), (1.0, 0.2, 0.6))
    )
    weights = {"tool0": 0.5, "gaze": 0.2, "posture": 2.0}
    targets = dict.fromkeys(("tool0", "attitude"), maira.forward(maira.clip(q + 0.05)))
    called, asked = solver.step(q, targets, DT, weights=weights), built.step(q, targets, DT)
    np.testing.assert_allclose(called.q, asked.q, rtol=0, atol=1e-12)
    assert np.abs(called.q - solver.step(q, targets, DT).q).max() > 1e-6


@pytest.mark.parametrize("backend", [None, "daqp"])
def test_what_is_switched_off_is_as_if_it_had_not_been_given(maira, q, other, backend):
    gaze = mq.LookAtTask(frame="link5", point=[1, 1, 1], priority=2, name="gaze")
    task, rest = mq.PoseTask(), mq.Strict(mq.Posture(other))
    solver = mq.Solver(maira, task=task, tasks=[gaze], redundancy=rest, backend=backend)
    T = maira.forward(maira.clip(q + 0.05))
    for off, built in {
        ("gaze",): mq.Solver(maira, redundancy=rest, backend=backend),
        ("posture",): mq.Solver(maira, tasks=[gaze], backend=backend),
        ("tool0",): mq.Solver(maira, task=dataclasses.replace(gaze, priority=1), redundancy=rest, backend=backend),
        ("gaze", "posture"): mq.Solver(maira, backend=backend),
    }.items():
        weights, target = dict.fromkeys(off, 0), None if "tool0" in off else T
        for _ in range(2):  # the second time with engines that were kept
            called, asked = solver.step(q, {"tool0": T}, DT, weights=weights), built.step(q, target, DT)
            np.testing.assert_allclose(called.q, asked.q, rtol=0, atol=1e-12, err_msg=str(off))
        called, asked = solver.solve(T, q, weights=weights), built.solve(target, q)
        assert (called.success, called.status) == (asked.success, asked.status)
        np.testing.assert_allclose(called.q, asked.q, rtol=0, atol=1e-8, err_msg=str(off))
    moved = solver.step(q, {"tool0": T, "gaze": [0, 1, 0], "posture": q}, DT, weights={"gaze": 0})
    other_posture = mq.Solver(maira, redundancy=mq.Strict(mq.Posture(q)), backend=backend).step(q, T, DT)
    np.testing.assert_allclose(moved.q, other_posture.q, rtol=0, atol=1e-12)


def test_where_everything_is_switched_off_the_arm_stands(maira, q):
    solver = mq.Solver(maira, redundancy=mq.Strict(mq.Posture()))
    off = dict.fromkeys(solver.names, 0)
    T = maira.forward(maira.middle + 0.3)
    for target in (T, None, {"tool0": T, "posture": q}):
        step = solver.step(q, target, DT, weights=off)
        assert not step.velocity.any()
        for q0, there in ((q, q), (None, maira.middle)):
            solution = solver.solve(target, q0, weights=off)
            assert solution.success
            np.testing.assert_array_equal(solution.q, there)
    for targets in ([T, T], {"tool0": [T, T]}, [{"tool0": T}] * 2, {"tool0": [T, T], "posture": q}):
        np.testing.assert_array_equal(solver.solve_batch(targets, q, weights=off).q, [q, q])
    nothing = mq.Solver(maira, task=mq.PositionTask(position_weight=0))
    assert not nothing.step(q, None, DT).velocity.any()
    assert nothing.solve({"tool0": T}, q).success


def test_a_task_of_ones_own_has_a_name_a_datum_and_a_weight(maira, q):
    @dataclasses.dataclass(frozen=True, kw_only=True)
    class Height(mq.Task):
        height: float
        weight: float = 1.0

        @property
        def weights(self):
            return self.weight

        def with_value(self, value):
            return dataclasses.replace(self, height=value)

        def error(self, at):
            return np.array([self.height - at.placement().translation[2]])

        def jacobian(self, at):
            return at.jacobian()[2:3]

    solver = mq.Solver(maira, task=Height(height=0.5), redundancy=mq.Strict(mq.Posture(q)))
    assert solver.names == ("height", "posture")
    solution = solver.solve({"height": 0.6}, q)
    assert maira.forward(solution.q).translation[2] == pytest.approx(0.6, abs=1e-6)
    assert solver.step(q, None, DT, weights={"height": 0.0}).velocity == pytest.approx(np.zeros(7))
    with pytest.raises(OptionError, match="'limit_distance', a LimitDistance, takes no value"):
        mq.Solver(maira, redundancy=mq.Strict(mq.LimitDistance())).solve({"tool0": POSE, "limit_distance": 1})


def test_names_are_those_given_or_the_frame_or_a_word_for_the_class(maira):
    solver = mq.Solver(
        maira,
        task=[mq.PositionTask(), mq.OrientationTask()],
        tasks=[
            mq.LookAtTask(frame="tool0", point=[1, 1, 1], priority=2, name="gaze"),
            mq.LookAtTask(frame="link5", point=[1, 1, 1], priority=2),
            mq.LookAtTask(frame="link6", point=[1, 1, 1], priority=2),
            mq.LookAtTask(frame="link6", point=[1, 0, 1], priority=2),
            mq.SwivelTask(**ELBOW, angle=0.2),
            mq.ObjectiveTask(mq.Posture(name="rest"), priority=3),
        ],
        redundancy=mq.Strict(mq.LimitDistance()),
    )
    assert solver.names == ("tool0", "gaze", "link5", "swivel", "rest", "limit_distance")
    with pytest.raises(OptionError, match="'gaze' is given twice, to a PoseTask and to a LookAtTask"):
        mq.Solver(maira, task=mq.PoseTask(name="gaze"), tasks=[mq.LookAtTask(point=[1, 1, 1], name="gaze")])
    with pytest.raises(OptionError, match="takes its target by the name of that frame"):
        mq.Solver(maira, tasks=[mq.LookAtTask(point=[1, 1, 1], name="tool0")])
    for name in ("", 3):
        with pytest.raises(OptionError, match="name of a PoseTask must be text"):
            mq.PoseTask(name=name)


def test_two_tasks_of_one_frame_may_have_two_targets(maira, q):
    task = [mq.PositionTask(name="place"), mq.OrientationTask()]
    solver, goal = mq.Solver(maira, task=task), maira.forward(maira.clip(q + 0.1))
    assert solver.problem.target_keys == ("place", "tool0")
    solution = solver.solve({"place": goal, "tool0": maira.forward(q)}, q)
    assert solution.success
    there = maira.forward(solution.q)
    np.testing.assert_allclose(there.translation, goal.translation, atol=2e-6)
    np.testing.assert_allclose(there.rotation, maira.forward(q).rotation, atol=3e-6)


@pytest.mark.parametrize(
    ("target", "weights", "error", "words"),
    [
        ({"gaze": [1, 0, 0]}, None, FrameError, "no task 'gaze'; there are 'tool0', 'posture'"),
        (None, {"gaze": 1}, FrameError, "no task 'gaze'; there are"),
        (None, {"posture": -1}, OptionError, "'posture' is multiplied by a number >= 0"),
        (None, {"posture": np.nan}, OptionError, "'posture' is multiplied by a number >= 0"),
        (None, [1, 2], OptionError, "weights must be a mapping"),
        (None, {"cell": 0}, OptionError, "'cell' is a hard limit"),
        (None, {"cell": 2}, OptionError, "'cell' is a hard limit"),
        ({"posture": [1, 2]}, None, OptionError, "reference of 'posture'"),
        ({"posture": np.zeros(7), "tool0": None}, None, PoseError, "target"),
        ({"posture": np.zeros(7)}, {}, PoseError, "the tasks need a target"),
    ],
)
def test_what_is_no_name_and_no_datum_is_said(maira, q, target, weights, error, words):
    cell = mq.BoxLimit(upper=[3, 3, 3], name="cell")
    solver = mq.Solver(maira, limits=[cell], redundancy=mq.Strict(mq.Posture()))
    for call in (
        lambda: solver.solve(target, q, weights=weights),
        lambda: solver.step(q, target, DT, weights=weights),
    ):
        with pytest.raises(error, match=words):
            call()


def test_a_batch_takes_a_datum_for_all_or_one_each(maira, q, other):
    solver = mq.Solver(maira, redundancy=mq.Strict(mq.Posture()))
    T = np.array([maira.forward(maira.clip(q + d)).homogeneous for d in (0.0, 0.1, 0.2)])
    postures = np.array([q, other, maira.middle])
    for targets, each in (
        ({"tool0": T, "posture": postures}, postures),
        ([{"tool0": pose, "posture": p} for pose, p in zip(T, postures, strict=True)], postures),
        ({"tool0": T, "posture": other}, [other] * 3),
    ):
        batch = solver.solve_batch(targets, q)
        assert batch.backend == "compiled"
        for i, posture in enumerate(each):
            alone = solver.solve({"tool0": T[i], "posture": posture}, q)
            np.testing.assert_allclose(batch.q[i], alone.q, rtol=0, atol=1e-12)
            np.testing.assert_allclose(batch[i].jacobian(), alone.jacobian(), atol=1e-9)
        np.testing.assert_array_equal(batch[1:].q, batch.q[1:])
        np.testing.assert_allclose(batch[1:][0].jacobian(), batch[1].jacobian())
        np.testing.assert_array_equal(pickle.loads(pickle.dumps(batch)).q, batch.q)
    T[1, 0, 0] = np.nan
    spoilt = solver.solve_batch({"tool0": T, "posture": postures}, q)
    assert spoilt.status[1] == mq.Status.INVALID_TARGET
    assert np.isfinite(spoilt.q[[0, 2]]).all()
    for wrong in (np.full(maira.n, np.nan), np.zeros(maira.n - 1)):  # none of their numbers is a posture
        with pytest.raises(OptionError, match="reference of 'posture' must be"):
            solver.solve_batch({"tool0": T, "posture": wrong})
    with pytest.raises(OptionError, match="as many values for each"):
        solver.solve_batch({"tool0": T, "posture": postures[:2]}, q)
    with pytest.raises(FrameError, match="no task 'gaze'"):
        solver.solve_batch({"tool0": T, "gaze": postures}, q)


def test_a_batch_of_tasks_with_targets_of_their_own_differs_by_other_data(maira, q, other):
    solver = mq.Solver(maira, task=mq.PoseTask(target=maira.forward(q)), redundancy=mq.Strict(mq.Posture()))
    postures = np.array([q, other])
    batch = solver.solve_batch({"posture": postures})
    for i in range(2):
        np.testing.assert_allclose(batch.q[i], solver.solve({"posture": postures[i]}).q, atol=1e-9)


def test_a_path_takes_one_datum_for_all_poses(maira, q, other):
    solver = mq.Solver(maira, redundancy=mq.Strict(mq.Posture()))
    path = [maira.forward(maira.clip(q + d)) for d in np.linspace(0, 0.1, 5)]
    followed = solver.track({"tool0": path, "posture": other}, q)
    assert followed.success.all()
    drawn = mq.Solver(maira, redundancy=mq.Strict(mq.Posture(other))).track(path, q)
    np.testing.assert_allclose(followed.q, drawn.q, atol=1e-9)


def test_a_solver_that_has_made_engines_for_calls_pickles(maira, q, other):
    solver = mq.Solver(maira, redundancy=mq.Strict(mq.Posture()))
    T = maira.forward(maira.clip(q + 0.02))
    expected = solver.step(q, {"tool0": T, "posture": other}, DT, weights={"posture": 0})
    copy = pickle.loads(pickle.dumps(solver))
    again = copy.step(q, {"tool0": T, "posture": other}, DT, weights={"posture": 0})
    np.testing.assert_array_equal(again.q, expected.q)


def test_a_tracker_passes_data_on_and_keeps_them_until_others_come(maira, q, other):
    solver = mq.Solver(maira.limited(acceleration=10.0), redundancy=mq.Strict(mq.Posture(q)))
    tracker, still = (mq.Tracker(solver, q) for _ in range(2))
    T = maira.forward(q)
    with_posture = [tracker.update({"tool0": T, "posture": other} if k == 0 else T, DT) for k in range(5)]
    assert all(command.state == mq.TrackerState.FOLLOWING for command in with_posture)
    assert np.abs(with_posture[-1].q - q).max() > 1e-5
    assert np.abs([still.update(T, DT).q - q for _ in range(5)]).max() < 1e-6
    refused = tracker.update({"tool0": T, "posture": [1.0]}, DT)
    assert refused.state == mq.TrackerState.HOLDING
    assert "reference of 'posture'" in refused.reason
    assert "no task 'gaze'" in tracker.update({"tool0": T, "gaze": [1, 0, 0]}, DT).reason
