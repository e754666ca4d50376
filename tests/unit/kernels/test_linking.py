"""The dynamic programming through layers, against all lines one by one."""

from itertools import pairwise, product

import numpy as np
import pytest

import maira_qp as mq
from maira_qp.robots.model.revolutions import TURN, WholeTurns
from maira_qp.solvers.paths.line import RECONFIGURATION, best_line


def planar(*ranges: float) -> WholeTurns:
    """Whole turns of an arm in the plane whose joints move by so much to either side."""
    robot = mq.Robot.from_dh([{"a": 0.3, "d": 0.0, "alpha": 0.0, "lower": -r, "upper": r} for r in ranges])
    return WholeTurns(robot, robot.middle)


def cost(line: list[np.ndarray], windows: np.ndarray, turns: WholeTurns) -> float:
    """What a line (L, n) costs whose turns are counted."""
    total = 0.0
    for (before, here), window in zip(pairwise(line), windows, strict=True):
        moved = turns.shortest(here - before)
        far = np.abs(moved / window).max()
        follows = far <= 1.0 and np.abs(moved - (here - before)).max() < 1e-9
        total += far**2 if follows else RECONFIGURATION + far
    return total


@pytest.mark.parametrize("is_start_given", [False, True])
@pytest.mark.parametrize("seed", range(12))
def test_no_line_costs_less(seed, is_start_given):
    """Few layers of few nodes: every line is tried, from each number of turns to each.

    Of lines with reconfigurations it is only said that there are none with fewer.
    """
    rng = np.random.default_rng(seed)
    turns, L = planar(1.5 * TURN, 2.0), 4
    layers = [rng.uniform([-np.pi, -2.0], [np.pi, 2.0], size=(rng.integers(1, 4), 2)) for _ in range(L)]
    layers[0] = layers[0][:1] if is_start_given else layers[0]
    windows = rng.uniform(0.5, 3.0, size=(L - 1, 2))
    line = best_line(layers, windows, set(), turns, is_start_given)
    turned = [turns.all_within(layer, 100)[0] for layer in layers]
    turned[0] = layers[0] if is_start_given else turned[0]
    least = min(cost(list(nodes), windows, turns) for nodes in product(*turned))
    chosen = np.concatenate(layers)[line.chosen]
    assert line.reconfigurations == round(least // RECONFIGURATION)
    if not line.reconfigurations:
        np.testing.assert_allclose(cost(list(line.q), windows, turns), least, rtol=1e-12)
    np.testing.assert_allclose(turns.shortest(line.q - chosen), 0.0, atol=1e-12)
    assert (np.abs(line.q) <= [1.5 * TURN, 2.0]).all()


def test_a_dearer_way_that_leaves_room_is_taken_where_the_cheaper_does_not():
    """Two ways to the same node, the cheaper one by a turn to the one side, after which there is room to the other."""
    turns, aside = planar(1.05 * TURN, 2.0), np.array([0.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.0])
    short, long = np.linspace(0.0, -TURN, 9), np.linspace(0.0, TURN, 9)
    ways = np.stack([np.stack([short, aside], axis=1), np.stack([long, -1.1 * aside], axis=1)], axis=1)
    layers = [turns.in_window(way) for way in ways]
    layers[0], layers[8] = layers[0][:1], layers[8][:1]
    layers += [turns.in_window(np.array([[-angle, 0.0]])) for angle in np.linspace(0.0, 1.0, 5)[1:]]
    line = best_line(layers, np.full((12, 2), 1.2), set(), turns, is_start_given=True)
    assert line.reconfigurations == 0
    np.testing.assert_allclose(line.q[8], [TURN, 0.0], atol=1e-12)


def test_joints_with_many_turns_count_as_without_limits():
    """More numbers of turns than are counted: the line is within the limits all the same."""
    turns, angles = planar(*(20.5 * TURN,) * 3), np.linspace(0.0, 3 * TURN, 90)
    layers = [turns.in_window(np.array([[angle, 0.0, -angle]])) for angle in angles]
    line = best_line(layers, np.full((89, 3), 0.5), set(), turns, is_start_given=False)
    assert line.reconfigurations == 0
    np.testing.assert_allclose(np.diff(line.q[:, 0]), np.diff(angles), atol=1e-12)
    assert (np.abs(line.q) <= 20.5 * TURN).all()


def test_an_edge_that_is_forbidden_is_not_taken():
    layers = [np.array([[0.0]]), np.array([[0.1], [0.5]]), np.array([[0.2]])]
    windows, turns = np.ones((2, 1)), planar(3.0)
    first = best_line(layers, windows, set(), turns, is_start_given=False)
    assert first.chosen == [0, 1, 3]
    second = best_line(layers, windows, {first.edge(1)}, turns, is_start_given=False)
    assert second.chosen == [0, 2, 3]
    third = best_line(layers, windows, {first.edge(1), second.edge(1)}, turns, is_start_given=False)
    assert third.reconfigurations == 1


@pytest.mark.parametrize("is_start_given", [False, True])
def test_turns_leave_room_for_the_travel(is_start_given):
    """Two turns of a joint that has three: they fit from its lower limit on, and not from a start in the middle."""
    turns, angles = planar(1.5 * TURN), np.linspace(0.0, 2.0 * TURN, 60)
    layers = [turns.in_window(np.array([[angle]])) for angle in angles]
    line = best_line(layers, np.full((59, 1), 0.5), set(), turns, is_start_given)
    if is_start_given:
        assert line.reconfigurations == 1
        assert line.q[0, 0] == angles[0]
    else:
        assert line.reconfigurations == 0
        np.testing.assert_allclose(np.diff(line.q[:, 0]), np.diff(angles), atol=1e-12)
    assert (np.abs(line.q) <= 1.5 * TURN).all()


def test_the_roots_of_a_broken_line_are_those_that_lead_farthest():
    """Three ways of which the first ends after 3 layers, the second after 5, the third begins in the second layer."""
    turns = planar(3.0)
    ends = [(0.0, range(3)), (1.0, range(5)), (2.0, range(1, 8))]
    layers = [np.array([[where + 0.01 * k] for where, when in ends if k in when]) for k in range(8)]
    line = best_line(layers, np.full((7, 1), 0.1), set(), turns, is_start_given=False)
    assert line.reconfigurations == 1
    np.testing.assert_array_equal(line.roots, [[1.0]])
    whole = best_line(layers[1:], np.full((6, 1), 0.1), set(), turns, False)
    np.testing.assert_array_equal(whole.roots, [[2.01]])
