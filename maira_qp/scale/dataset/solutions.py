"""All solutions of each pose, as arrays of one shape: what is not there is NaN."""

from __future__ import annotations

import numpy as np

from maira_qp.results.batch import BatchSolution
from maira_qp.scale.reach.metrics import limit_distances, manipulabilities
from maira_qp.solvers.solver import Solver

FIGURES = ("position_error", "orientation_error", "manipulability", "limit_distance")


def all_solutions(solver: Solver, T: np.ndarray, batch: BatchSolution, seed: int, most: int) -> dict[str, np.ndarray]:
    """The best `most` solutions (N, most, ...) of poses (N, 4, 4), how many there are (N,), and whether these are all.

    Of a pose without one there is what a solve has found, in `batch`, in place of the first.
    """
    count, robot = len(T), solver.robot
    q = np.full((count, most, robot.n), np.nan)
    figures = {name: np.full((count, most), np.nan) for name in FIGURES}
    solutions, complete = np.zeros(count, dtype=np.int32), np.zeros(count, dtype=bool)
    q[:, 0] = batch.q
    figures["position_error"][:, 0], figures["orientation_error"][:, 0] = batch.position_error, batch.orientation_error
    for i in np.flatnonzero(batch.success):
        found = solver.solutions(T[i], rng=seed)
        solutions[i], complete[i] = len(found), found.is_complete and len(found) <= most
        for k, one in enumerate(found[:most]):
            q[i, k] = one.q
            figures["position_error"][i, k] = one.position_error
            figures["orientation_error"][i, k] = one.orientation_error
    known = np.isfinite(q).all(axis=2)
    for name, metric in (("manipulability", manipulabilities), ("limit_distance", limit_distances)):
        figures[name][known] = metric(robot, q[known])
    return {"q": q, "solutions": solutions, "complete": complete, **figures}
