"""The methods that a benchmark compares, all called alike: the package's solver and the references of the textbooks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from maira_qp.errors import OptionError, listed
from maira_qp.evaluation.baselines import BaselineResult, dh_clamped, gradient_descent_pose, newton_pose
from maira_qp.evaluation.baselines.joints import within_a_turn
from maira_qp.evaluation.contestant import Answer, Contestant
from maira_qp.evaluation.settings import METHODS, NO_BACKEND
from maira_qp.evaluation.targets import Target
from maira_qp.problem.objectives import Posture
from maira_qp.problem.options import Options
from maira_qp.problem.redundancy import Strict, Weighted
from maira_qp.results.solution import Solution
from maira_qp.robots.dh.table import DHTable
from maira_qp.robots.model.robot import Robot
from maira_qp.solvers.solver import Solver

REFERENCES = ("dh-clamped", "newton", "gradient")
"""Methods of the textbooks: they need a DH table and no QP backend, and start once."""


def methods(
    robot: Robot, names: Sequence[str], backends: Sequence[str], weight: float, options: Options
) -> tuple[list[Contestant], list[str]]:
    """The methods of those names, the QP methods once a backend, and a note for each that this robot cannot have.

    The references stop at the options' tolerances, the textbooks' own settings otherwise. Raises `OptionError` for an
    unknown name, `BackendError` for an unknown backend.
    """
    made: list[Contestant] = []
    notes: list[str] = []
    for name in names:
        if name not in METHODS:
            raise OptionError(f"unknown method {name!r}; {listed(METHODS, name)}")
        if name not in REFERENCES:
            made += [qp_method(robot, name, backend, weight, options) for backend in backends]
        elif robot.dh is not None:
            made.append(reference_method(robot.dh, name, options))
        else:
            notes.append(f"{name} is left out: it needs a DH table, and {robot.name} comes from a URDF")
    return made, notes


def qp_method(
    robot: Robot, name: str, backend: str, weight: float, options: Options, label: str | None = None
) -> Contestant:
    """The package's solver: `pose` alone, or with the posture nearest to mid-range `weighted`, `fading` or `strict`."""
    redundancy = {
        "pose": None,
        "weighted": Weighted(Posture(), weight),
        "fading": Weighted(Posture(), weight, fading=True),
        "strict": Strict(Posture()),
    }[name]
    solver = Solver(robot, redundancy=redundancy, backend=backend, options=options)

    def solve(target: Target, start: np.ndarray | None) -> Solution:
        return solver.solve(target.pose, q0=start, rng=np.random.default_rng(target.seed))

    def answer(s: Solution) -> Answer:
        return Answer(s.q, s.success, s.status.name, s.iterations, s.restarts)

    return Contestant(name=label or name, settings=backend, solve=solve, answer=answer)


def reference_method(table: DHTable, name: str, options: Options) -> Contestant:
    """A reference on the plain DH chain. Gradient descent may end whole turns away: its angles are brought back."""
    position, orientation = options.position_tolerance, options.orientation_tolerance

    def solve(target: Target, start: np.ndarray) -> BaselineResult:
        pose = target.pose
        if name == "dh-clamped":
            return dh_clamped(table, pose, start, tolerance=min(position, orientation))
        if name == "newton":
            return newton_pose(table, pose, start, position_tolerance=position, orientation_tolerance=orientation)
        return gradient_descent_pose(table, pose, start, position_tolerance=position, orientation_tolerance=orientation)

    def answer(result: BaselineResult) -> Answer:
        status = "CONVERGED" if result.converged else "PROXIMAL"
        return Answer(within_a_turn(table, result.q), result.converged, status, result.iterations)

    return Contestant(name=name, settings=NO_BACKEND, solve=solve, answer=answer)
