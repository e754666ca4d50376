"""What solutions are called: by their branch, where that has a name."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from maira_qp.results.solution_set import ListedSolution
from maira_qp.robots.model.robot import Robot

LEVEL = 0.02
"""An elbow nearer to the line from shoulder to wrist, up or down, than this share of the arm's length is level."""
SIGNS = {1: "+", -1: "-"}


def names_of(robot: Robot, solutions: Sequence[ListedSolution]) -> tuple[str, ...]:
    """A number each, and what is known of the branch."""
    return tuple(": ".join(filter(None, [str(i), _branch(robot, one)])) for i, one in enumerate(solutions, start=1))


def _branch(robot: Robot, one: ListedSolution) -> str:
    if robot.n < 6 or len(robot.tips) > 1:
        return ""
    words = [elbow_word(robot, one.q)]
    if one.branch is not None:
        words += [f"shoulder {SIGNS[one.branch.shoulder]}", f"wrist {SIGNS[one.branch.wrist]}"]
    elif robot.n == 6:
        words.append("wrist +" if np.sin(one.q[4]) >= 0 else "wrist -")
    return ", ".join(words)


def elbow_word(robot: Robot, q: np.ndarray) -> str:
    """Whether the elbow of an arm of at least six joints is above the line from its shoulder to its wrist."""
    at = robot.at(q)
    links = robot.moved_links
    shoulder, elbow, wrist = (at.placement(links[i]).translation for i in (1, (robot.n - 1) // 2, robot.n - 2))
    line = wrist - shoulder
    share = float((elbow - shoulder) @ line / max(line @ line, 1e-12))
    height = float((elbow - shoulder - share * line)[2])
    if abs(height) < LEVEL * robot.length:
        return "elbow level"
    return "elbow up" if height > 0 else "elbow down"
