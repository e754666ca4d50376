"""Layers of configurations along a path, and what links them."""

import numpy as np
from support.robots import load

import maira_qp as mq
from maira_qp.problem.targets import row_of
from maira_qp.solvers.paths.continuity import is_continuous
from maira_qp.solvers.paths.descents import PathArrays
from maira_qp.solvers.paths.layers import Density, layer_indices, layers_of
from maira_qp.solvers.paths.links import misleading


def two_links() -> mq.Robot:
    link = {"d": 0.0, "alpha": 0.0, "lower": -3.0, "upper": 3.0}
    return mq.Robot.from_dh([{"a": 0.5, **link}, {"a": 0.5, **link}])


def path_of(robot: mq.Robot, motion: np.ndarray, step: float, **problem) -> PathArrays:
    """The poses of a motion (N, n), and the problem that follows them."""
    engines = mq.Solver(robot, **problem).engines
    rows = np.array([row_of(robot.forward(q)) for q in motion])
    return PathArrays(engines.compiled, rows, np.arange(len(rows)), np.full(robot.n, step), engines.problem)


def test_an_elbow_does_not_flip_between_two_poses():
    """Nearly stretched, the two ways to bend are 0.4 rad apart: a small step, and not along the path."""
    robot = two_links()
    bent = np.array([[0.2, -0.4], [0.21, -0.41], [0.21 - 0.41, 0.41]])
    path = path_of(robot, bent, 0.5, task=mq.PositionTask())
    np.testing.assert_allclose(path.rows[1, 9:], path.rows[2, 9:], atol=1e-12)
    assert is_continuous(path, np.arange(2), bent[:-1], bent[1:]).tolist() == [True, False]


def test_links_that_jump_are_told_from_those_that_lead_on():
    """The elbow, nearly stretched, bent to either side: two configurations a layer."""
    bent = np.array([[0.2 + 0.02 * k, -0.4] for k in range(7)])
    path = path_of(two_links(), bent, 0.5, task=mq.PositionTask())
    flipped = np.array([[a + b, -b] for a, b in bent])
    at = np.array([0, 3, 6])
    layers = [np.array([bent[k], flipped[k]]) for k in at]
    window = np.full(2, 1.0)
    assert misleading(path, at, layers, 1, window) == {(0, 3), (1, 2)}
    assert misleading(path, at, layers, 2, window) == {(2, 5), (3, 4)}
    assert misleading(path, at, layers, 1, np.full(2, 0.1)) == set()


def test_what_a_layer_holds_is_followed_back_to_a_singular_pose():
    """Where the wrist is stretched its joints trade turns for nothing, and few that are drawn lead on."""
    robot = load("ur5_limited")
    q = np.array([0.4, -1.2, 1.3, 0.7, 0.0, -1.1])
    motion = q + np.linspace(0.0, 1.0, 40)[:, None] * np.array([0.3, 0.2, -0.3, 0.4, 0.5, 0.2])
    path = path_of(robot, motion, 0.5)
    nodes, leading = [np.empty((0, 6)), *(each[None] for each in motion[1:])], []
    for both_ways in (False, True):
        density = Density(spacing=0.1, most=150, fresh=16, cell=0.15, both_ways=both_ways)
        at = layer_indices(path, density.spacing)
        first, second, *_ = layers_of(path, at, nodes, False, density, np.random.default_rng(0), {})
        leading.append((np.abs(second[:, None] - first).max(axis=2).min(axis=1) < 0.2).mean())
    assert leading[0] < leading[1]
    assert leading[1] > 0.6
