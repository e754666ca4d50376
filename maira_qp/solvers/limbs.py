"""Limbs that share no joint are independent problems: each is searched for with restarts of its own.

If one attempt succeeds with probability p for each of k limbs, restarts of all at once need p^-k attempts on average,
restarts of each p^-1. The limbs are the connected components of the graph of joints in which a task joins those that
move it (its Jacobian's columns that are not zero).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from maira_qp.problem.qp.costs import TaskCost
from maira_qp.problem.tasks.task import Task
from maira_qp.robots.model.robot import Robot
from maira_qp.solvers.reference.context import Context
from maira_qp.solvers.reference.levenberg_marquardt import Budget, Descent
from maira_qp.solvers.reference.multi_start import Reached, Search, random_start, search

GLANCES = 3
"""Random configurations at which it is looked which joints move a task: at a special one a column may vanish."""


@dataclass(frozen=True)
class Limb:
    """Tasks that share joints, directly or through others, and those joints."""

    cost: TaskCost
    joints: np.ndarray
    """(n,) bool"""


def limbs_of(cost: TaskCost, robot: Robot) -> list[Limb]:
    """The tasks by limbs, in the order of their first tasks."""
    rng = np.random.default_rng(0)
    glances = [robot.at(robot.random_configuration(rng)) for _ in range(GLANCES)]
    limbs: list[Limb] = []
    for task in cost.tasks:
        joints, apart, tasks = _movers(task, glances), [], (task,)
        for limb in limbs:
            if (limb.joints & joints).any():
                joints, tasks = joints | limb.joints, (*limb.cost.tasks, *tasks)
            else:
                apart.append(limb)
        limbs = [*apart, Limb(TaskCost(tasks), joints)]
    return limbs


def _movers(task: Task, glances: list) -> np.ndarray:
    """Which joints (n,) move a task; all, where that depends on which rows of a limit are broken."""
    if task.is_wish:
        return np.ones(glances[0].n, dtype=bool)
    return np.any([(task.rows(at)[0] != 0).any(axis=0) for at in glances], axis=0)


def search_limbs(
    cost: TaskCost,
    q0: np.ndarray | None,
    context: Context,
    budget: Budget,
    rng: Callable[[], np.random.Generator],
    reached_of: Callable[[TaskCost], Reached],
    max_restarts: int | None = None,
    is_hopeless: Callable[[], bool] | None = None,
) -> Search:
    """`search`, limb by limb: while one is searched for, the joints of the others stay where they are.

    `reached_of` makes the criterion of some of the tasks. `restarts` is the largest number that a limb needed. Further
    limits may join what the tasks leave apart: where some limb was not reached within them, or the limbs together are
    not, all joints are searched for at once, from what was found.
    """
    limbs = limbs_of(cost, context.robot)
    whole = reached_of(cost)
    if len(limbs) < 2:
        return search(cost, q0, context, budget, rng, whole, max_restarts, is_hopeless)
    q = random_start(cost, context, rng(), budget).q if q0 is None else q0
    restarts, left = 0, False
    for limb in limbs:
        part = replace(context, narrowed=tuple(np.where(limb.joints, end, q) for end in context.sampling_range))
        start = None if q0 is None else q
        found = search(limb.cost, start, part, budget, rng, reached_of(limb.cost), max_restarts, is_hopeless)
        q, restarts = np.where(limb.joints, found.best.at.q, q), max(restarts, found.restarts)
        left = left or found.left
        if found.proved:
            return Search(_ended(q, cost, context, whole), restarts, True, left)
    end = _ended(q, cost, context, whole)
    if end.reached or not context.further or budget.late():
        return Search(end, restarts, left=left)
    return search(cost, context.admitted(q), context, budget, rng, whole, max_restarts, is_hopeless)


def _ended(q: np.ndarray, cost: TaskCost, context: Context, reached: Reached) -> Descent:
    """A descent that ended at q (n,)."""
    at = context.robot.at(q)
    return Descent(at, cost.value(at), reached(at), context.broken(at))
