"""Layers of configurations along a path, and what links them."""

from itertools import pairwise

import numpy as np
import pinocchio as pin
from support.robots import load

import maira_qp as mq
from maira_qp.problem.targets import row_of
from maira_qp.solvers.paths.continuity import is_continuous, misleading
from maira_qp.solvers.paths.descents import PathArrays
from maira_qp.solvers.paths.layers import Density, layer_indices, layers_from, layers_of


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
    assert misleading(path, at, layers, 1, window, bent[0]) == {(0, 3), (1, 2)}
    assert misleading(path, at, layers, 2, window, bent[3]) == {(2, 5), (3, 4)}
    assert misleading(path, at, layers, 1, np.full(2, 0.1), bent[0]) == set()


def end_of_self_motion(path: PathArrays, q: np.ndarray, sign: float, far: float) -> np.ndarray | None:
    """Where a self-motion from a configuration (n,) leaves the limits, followed in steps; None: it goes on so far."""
    robot, T, direction, step = path.problem.robot, path.problem.robot.forward(q), None, 2e-3
    for _ in range(round(far / step)):
        along = np.linalg.svd(robot.jacobian(q))[2][-1]
        along *= sign if direction is None else np.sign(along @ direction)
        there = q + step * along
        for _ in range(3):
            M = robot.forward(there)
            twist = np.concatenate([T.translation - M.translation, pin.log3(T.rotation @ M.rotation.T)])
            there = there + np.linalg.pinv(robot.jacobian(there)) @ twist
        room = np.minimum(there - robot.lower, robot.upper - there)
        if room.min() < 0.0:
            i = room.argmin()
            before = np.minimum(q - robot.lower, robot.upper - q)[i]
            return q + before / (before - room[i]) * (there - q)
        q, direction = there, along
    return None


def test_thorough_layers_hold_where_self_motions_end_at_limits():
    """But for the few that others on the same limit stand for."""
    robot, rng = mq.Robot.load("panda"), np.random.default_rng(4)
    start = robot.lower + (robot.upper - robot.lower) * rng.uniform(0.2, 0.8, size=7)
    path = path_of(robot, start + np.linspace(0.0, 0.1, 3)[:, None] * rng.normal(size=7), 0.5)
    density = Density(spacing=0.01, most=200, fresh=60, cell=0.1, is_thorough=True)
    *_, layer = layers_of(path, np.arange(3), [np.empty((0, 7))] * 3, False, density, rng)
    ends = [end_of_self_motion(path, q, sign, 0.25) for q in layer[:120] for sign in (-1.0, 1.0)]
    found = [
        np.abs(path.problem.turns.shortest(layer - end)).max(axis=1).min() < 1e-3 for end in ends if end is not None
    ]
    assert len(found) > 15
    assert np.mean(found) > 0.85


def test_layers_from_roots_hold_nothing_but_what_these_lead_to():
    """Whatever is far along the self-motion in the first layer is not there; what is near leads to the last one."""
    robot, rng = mq.Robot.load("panda"), np.random.default_rng(0)
    motion = robot.middle + np.linspace(0.0, 0.3, 12)[:, None] * rng.normal(size=7)
    path, density = path_of(robot, motion, 0.1), Density(spacing=0.01, most=60, fresh=0, cell=0.05)
    windows = np.full((11, 7), 0.1)
    layers = layers_from(path, np.arange(12), motion[:1], windows, density, rng)
    assert len(layers) == 12
    for k, (before, here) in enumerate(pairwise(layers), 1):
        assert (np.abs(here[:, None] - before).max(axis=2).min(axis=1) <= 0.1).all()
        assert ((robot.lower <= here) & (here <= robot.upper)).all()
        assert (path.errors(path.rows[np.full(len(here), k)], here) < 1.1e-6).all()
    assert np.abs(layers[-1] - motion[-1]).max(axis=1).min() < 0.1
    far = np.full((1, 7), 9.0)
    assert len(layers_from(path, np.arange(12), far, windows, density, rng)) == 1


def test_what_a_layer_holds_is_followed_back_to_a_singular_pose():
    """Where the wrist is stretched its joints trade turns for nothing, and few that are drawn lead on."""
    robot = load("ur5_limited")
    q = np.array([0.4, -1.2, 1.3, 0.7, 0.0, -1.1])
    motion = q + np.linspace(0.0, 1.0, 40)[:, None] * np.array([0.3, 0.2, -0.3, 0.4, 0.5, 0.2])
    path = path_of(robot, motion, 0.5)
    nodes, leading = [np.empty((0, 6)), *(each[None] for each in motion[1:])], []
    for is_thorough in (False, True):
        density = Density(spacing=0.1, most=150, fresh=16, cell=0.15, is_thorough=is_thorough)
        at = layer_indices(path, density.spacing)
        first, second, *_ = layers_of(path, at, nodes, False, density, np.random.default_rng(0))
        leading.append((np.abs(second[:, None] - first).max(axis=2).min(axis=1) < 0.2).mean())
    assert leading[0] < leading[1]
    assert leading[1] > 0.6
