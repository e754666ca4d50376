"""Objectives of the redundancy: derivatives by differences on real robots, meaning at known configurations."""

import numpy as np
import pytest
from support.derivatives import assert_close, difference_gradient, difference_jacobian
from support.robots import load

import maira_qp as mq
from maira_qp.errors import FrameError, OptionError

ROBOTS = ["maira", "panda", "pr2_arm", "tiago", "ur5", "panda_finger"]
OBJECTIVES = {
    "posture": mq.Posture(),
    "limit distance": mq.LimitDistance(),
    "manipulability": mq.Manipulability(),
    "obstacle": mq.ObstacleDistance([0.3, 0.2, 0.5]),
}


@pytest.fixture(scope="module", params=ROBOTS)
def robot(request) -> mq.Robot:
    return mq.Robot.maira() if request.param == "maira" else load(request.param)


@pytest.mark.parametrize("name", OBJECTIVES)
def test_gradient_and_hessian_are_those_of_the_cost(robot, name, rng):
    """On arms with revolute, prismatic, continuous and mimic joints."""
    objective = OBJECTIVES[name].of(robot)
    for _ in range(5):
        q = robot.random_configuration(rng)
        at = robot.at(q)
        gradient = difference_gradient(lambda q: objective.cost(robot.at(q)), q)
        assert_close(objective.gradient(at), gradient, 1e-6)
        hessian = difference_jacobian(lambda q: objective.gradient(robot.at(q)), q, step=1e-4)
        assert_close(objective.hessian(at), 0.5 * (hessian + hessian.T), 1e-3)
        assert np.array_equal(objective.hessian(at), objective.hessian(at).T)


def test_the_posture_is_half_the_weighted_squared_distance(maira, rng):
    q, q_ref, w = rng.normal(size=7), rng.normal(size=7), rng.random(7)
    cost = mq.Posture(q_ref, w).of(maira).cost(maira.at(q))
    assert cost == pytest.approx(0.5 * sum(w * (q - q_ref) ** 2))
    assert mq.Posture(q_ref, 2.0).of(maira).cost(maira.at(q)) == pytest.approx(sum((q - q_ref) ** 2))
    assert mq.Posture(q_ref).of(maira).cost(maira.at(q_ref)) == 0.0


def test_the_limit_distance_is_the_lectures_formula(maira, rng):
    """`1/(2n) sum ((q - mid) / range)^2`; a continuous joint does not count."""
    q = rng.normal(size=7)
    value = mq.LimitDistance().of(maira).cost(maira.at(q))
    assert value == pytest.approx(np.sum((q - maira.middle) ** 2 / (maira.upper - maira.lower) ** 2) / 14)
    turning = mq.Robot.from_dh([mq.DHLink(kind="continuous", a=1), mq.DHLink(a=1, lower=-1, upper=1)])
    far, near = (mq.LimitDistance().of(turning).cost(turning.at(np.array([x, 0.5]))) for x in (100.0, 0.0))
    assert far == near


def test_manipulability_is_that_of_the_robot_and_finite_where_it_vanishes(maira, panda):
    q = np.full(7, 0.3)
    assert mq.Manipulability().of(maira).cost(maira.at(q)) == pytest.approx(-maira.manipulability(q))
    stretched = maira.at(np.zeros(7))
    assert abs(mq.Manipulability().of(maira).cost(stretched)) < 1e-15
    assert np.isfinite(mq.Manipulability().of(maira).gradient(stretched)).all()
    assert mq.Manipulability("panda_link6").of(panda).frame == "panda_link6"


def test_the_obstacle_distance_is_the_nearest_frames_up_to_its_smoothing(maira, rng):
    objective = mq.ObstacleDistance([0.3, 0.2, 0.5]).of(maira)
    for _ in range(50):
        q = maira.random_configuration(rng)
        origins = [maira.forward(q, frame).translation for frame in objective.frames]
        nearest = min(np.linalg.norm(p - objective.obstacle) for p in origins)
        assert objective.distance(maira.at(q)) == pytest.approx(nearest, abs=1e-12)
        smooth = -objective.cost(maira.at(q))
        assert nearest - np.log(len(origins)) / objective.sharpness - 1e-12 <= smooth <= nearest + 1e-12


def test_an_obstacle_in_the_arm_gives_no_nan(maira):
    objective = mq.ObstacleDistance(maira.forward(np.zeros(7), "link4").translation).of(maira)
    at = maira.at(np.zeros(7))
    assert np.isfinite(objective.cost(at))
    assert np.isfinite(objective.gradient(at)).all()


@pytest.mark.parametrize(
    "make",
    [
        lambda: mq.Posture(np.zeros(6)),
        lambda: mq.Posture(weights=np.ones(3)),
        lambda: mq.Posture(weights=-np.ones(7)),
        lambda: mq.Posture(weights=np.nan),
        lambda: mq.Posture([np.nan] * 7),
        lambda: mq.ObstacleDistance([0, 0]),
        lambda: mq.ObstacleDistance([0, 0, 0], sharpness=-1),
    ],
)
def test_an_objective_that_does_not_fit_the_robot_is_refused(maira, make):
    with pytest.raises(OptionError):
        mq.Solver(maira, redundancy=mq.Strict(make()))


def test_an_objectives_frame_must_exist(maira):
    with pytest.raises(FrameError, match="did you mean 'link4'"):
        mq.Solver(maira, redundancy=mq.Strict(mq.Manipulability("link44")))
    with pytest.raises(FrameError, match="tool0"):
        mq.Solver(maira, redundancy=mq.Strict(mq.ObstacleDistance([0, 0, 0], frames=("tool",))))


@pytest.mark.parametrize("make", [lambda: mq.Strict(), lambda: mq.Strict("posture"), lambda: mq.Weighted(mq.Posture)])
def test_a_redundancy_without_an_objective_is_refused(make):
    with pytest.raises(OptionError, match=r"Posture\(\)"):
        make()


@pytest.mark.parametrize("weight", [-1.0, np.nan, np.inf, "1"])
def test_the_weight_of_weighted_is_not_negative(weight):
    with pytest.raises(OptionError, match="weight"):
        mq.Weighted(mq.Posture(), weight=weight)


def definite(rng, n):
    A = rng.normal(size=(n, n))
    return A @ A.T + 0.1 * np.eye(n)


def test_a_posture_with_a_matrix_is_the_quadratic_form(robot, rng):
    M, q_ref = definite(rng, robot.n), robot.random_configuration(rng)
    objective, q = mq.Posture(q_ref, M).of(robot), robot.random_configuration(rng)
    at, d = robot.at(q), q - q_ref
    assert objective.cost(at) == pytest.approx(
        0.5 * sum(M[i, j] * d[i] * d[j] for i in range(len(d)) for j in range(len(d)))
    )
    assert_close(objective.gradient(at), difference_gradient(lambda q: objective.cost(robot.at(q)), q), 1e-5)
    assert_close(objective.hessian(at), M, 1e-12)
    assert_close(objective.costs(np.array([q, q_ref])), [objective.cost(at), 0.0], 1e-9)
    diagonal = mq.Posture(q_ref, np.diag(np.arange(robot.n))).of(robot)
    assert diagonal.is_diagonal
    assert diagonal.weights.tolist() == list(range(robot.n))


@pytest.mark.parametrize(
    ("weights", "match"),
    [
        (np.ones((7, 6)), r"shape \(7, 7\)"),
        (np.triu(np.ones((7, 7))), r"symmetric, but entry \(0, 1\) is 1"),
        (-np.ones((7, 7)), "positive semidefinite"),
        (np.zeros((7, 7)), "zero throughout"),
        (np.full((7, 7), np.nan), "finite"),
    ],
)
def test_a_matrix_that_is_none_for_weights_is_refused(maira, weights, match):
    for make in (
        lambda: mq.Posture(weights=weights).of(maira),
        lambda: mq.DampingTask(metric=weights).of(maira),
        lambda: mq.Solver(maira).solve(maira.forward(maira.middle), maira.middle, prefer="closest", metric=weights),
    ):
        with pytest.raises(OptionError, match=match):
            make()


@pytest.mark.parametrize("axes", ["translation", "rotation", ("x", "y", "rz"), "z", ["rx"]])
def test_manipulability_of_some_axes_is_the_volume_of_their_ellipsoid(robot, axes, rng):
    """sqrt(det(J J^T)) of these rows alone, its gradient by differences."""
    objective, q = mq.Manipulability(axes=axes).of(robot), robot.random_configuration(rng)
    names = (
        {"translation": "x y z", "rotation": "rx ry rz"}.get(axes, axes) if isinstance(axes, str) else " ".join(axes)
    )
    rows = [["x", "y", "z", "rx", "ry", "rz"].index(name) for name in names.split()]
    J = robot.jacobian(q)[rows]
    gram = J @ J.T if len(rows) <= robot.n else J.T @ J
    assert objective.cost(robot.at(q)) == pytest.approx(-np.sqrt(max(np.linalg.det(gram), 0.0)), abs=1e-9)
    gradient = difference_gradient(lambda q: objective.cost(robot.at(q)), q)
    assert_close(objective.gradient(robot.at(q)), gradient, 1e-6)


@pytest.mark.parametrize("axes", ["linear", ("x", "w"), 3, (), (1, 2)])
def test_manipulability_names_the_axes_that_there_are(maira, axes):
    with pytest.raises(OptionError, match=r"translation.*'rz'|translation.*rz"):
        mq.Manipulability(axes=axes).of(maira)


@pytest.mark.parametrize("gain", [0, -1.0, np.nan, np.inf, "1", True])
def test_a_gain_is_a_rate(maira, gain):
    for kind in (mq.Posture, mq.LimitDistance):
        with pytest.raises(OptionError, match=rf"gain of {kind.__name__} must be a positive number \[1/s\]"):
            kind(gain=gain).of(maira)
