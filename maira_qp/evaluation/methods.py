"""The methods that a benchmark compares, all called alike: the package's solver and the references of the textbooks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from maira_qp.errors import OptionError, listed
from maira_qp.evaluation.baselines import BaselineResult, dh_clamped, gradient_descent_pose, newton_pose
from maira_qp.evaluation.baselines.joints import within_a_turn
from maira_qp.evaluation.settings import METHODS
from maira_qp.evaluation.targets import Target
from maira_qp.problem.objectives import Posture
from maira_qp.problem.options import Options
from maira_qp.problem.redundancy import Strict, Weighted
from maira_qp.robots.dh.table import DHTable
from maira_qp.robots.model.robot import Robot
from maira_qp.solvers.solver import Solver

REFERENCES = ("dh-clamped", "newton", "gradient")
"""Methods of the textbooks: they need a DH table and no QP backend, and start once."""
NO_BACKEND = "-"


@dataclass(frozen=True)
class Answer:
    """What a method said."""

    q: np.ndarray
    """Configuration (n,)."""
    claimed: bool
    """Whether it says that the target is reached, to its own tolerance."""
    status: str
    """Its own word for how it ended."""
    iterations: int
    """Over all starts."""
    restarts: int
    """Starts after the first."""


@dataclass(frozen=True)
class Method:
    """A method ready to be asked."""

    name: str
    """What it is called in tables."""
    backend: str
    """Its QP backend, or "-"."""
    solve: Callable[[Target], Answer]
    """From a target to an answer; the same answer every time."""


def methods(
    robot: Robot, names: Sequence[str], backends: Sequence[str], weight: float, options: Options
) -> tuple[list[Method], list[str]]:
    """The methods of those names, the QP methods once a backend, and a note for each that this robot cannot have.

    The references stop at the options' tolerances, the textbooks' own settings otherwise. Raises `OptionError` for an
    unknown name, `BackendError` for an unknown backend.
    """
    made: list[Method] = []
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
) -> Method:
    """The package's solver: `pose` alone, or with the posture nearest to mid-range `weighted` or `strict`."""
    redundancy = {"pose": None, "weighted": Weighted(Posture(), weight), "strict": Strict(Posture())}[name]
    solver = Solver(robot, redundancy=redundancy, backend=backend, options=options)

    def solve(target: Target) -> Answer:
        s = solver.solve(target.pose, q0=target.start, rng=np.random.default_rng(target.seed))
        return Answer(s.q, s.success, s.status.name, s.iterations, s.restarts)

    return Method(label or name, backend, solve)


def reference_method(table: DHTable, name: str, options: Options) -> Method:
    """A reference on the plain DH chain. Gradient descent may end whole turns away: its angles are brought back."""
    position, orientation = options.position_tolerance, options.orientation_tolerance

    def solve(target: Target) -> Answer:
        pose, start = target.pose, target.start
        if name == "dh-clamped":
            result = dh_clamped(table, pose, start, tolerance=min(position, orientation))
        elif name == "newton":
            result = newton_pose(table, pose, start, position_tolerance=position, orientation_tolerance=orientation)
        else:
            result = gradient_descent_pose(
                table, pose, start, position_tolerance=position, orientation_tolerance=orientation
            )
        return _answer(table, result)

    return Method(name, NO_BACKEND, solve)


def _answer(table: DHTable, result: BaselineResult) -> Answer:
    status = "CONVERGED" if result.converged else "PROXIMAL"
    return Answer(within_a_turn(table, result.q), result.converged, status, result.iterations, 0)
