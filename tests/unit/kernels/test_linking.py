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


def cost(nodes: list[np.ndarray], windows: np.ndarray, turns: WholeTurns) -> float:
    """What a line (L, n) costs, turns counted by the shortest way."""
    total, end = 0.0, nodes[0]
    least = most = end
    for (before, here), window in zip(pairwise(nodes), windows, strict=True):
        moved = turns.shortest(here - before)
        far = np.abs(moved / window).max()
        end = end + moved
        low, high = np.minimum(least, end), np.maximum(most, end)
        if far <= 1.0 and turns.has_room(low, high, False):
            total, least, most = total + far**2, low, high
        else:
            total, end = total + RECONFIGURATION + far, here
            least = most = end
    return total


@pytest.mark.parametrize("seed", range(12))
def test_no_line_costs_less(seed):
    """Few layers of few nodes: every line is tried. Joints with room for all turns, so that none is lost on the way.

    Of lines with reconfigurations it is only said that there are none with fewer.
    """
    rng = np.random.default_rng(seed)
    turns, L = planar(50.0, 2.0), 4
    layers = [rng.uniform([-np.pi, -2.0], [np.pi, 2.0], size=(rng.integers(1, 5), 2)) for _ in range(L)]
    windows = rng.uniform(0.5, 3.0, size=(L - 1, 2))
    line = best_line(layers, windows, set(), turns, is_start_given=False)
    every = [cost(list(nodes), windows, turns) for nodes in product(*layers)]
    chosen = np.concatenate(layers)[line.chosen]
    assert line.reconfigurations == round(min(every) // RECONFIGURATION)
    if not line.reconfigurations:
        np.testing.assert_allclose(cost(list(chosen), windows, turns), min(every), rtol=1e-12)
    np.testing.assert_allclose(turns.shortest(line.q - chosen), 0.0, atol=1e-12)
    assert (np.abs(line.q) <= [50.0, 2.0]).all()


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
