"""The arrays of a problem that the kernels work with, and which problems have them.

One task of the tip of a serial chain with box limits, and, if there is a redundancy, one `Posture` or `LimitDistance`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from maira_qp.kernels.kinematics.unwrap import TURN
from maira_qp.kernels.layout import Joint, Setting, Settling
from maira_qp.kernels.search.multi_start import FARTHEST_START
from maira_qp.problem.objectives import LimitDistance, Posture
from maira_qp.problem.problem import Problem
from maira_qp.problem.redundancy import Strict, trades_off
from maira_qp.problem.targets import FARTHEST
from maira_qp.problem.tasks.frame import FrameTask
from maira_qp.robots.model.revolutions import WITHIN, WholeTurns
from maira_qp.robots.model.robot import Robot
from maira_qp.solvers import neighbourhood
from maira_qp.solvers.certificates import Proofs
from maira_qp.solvers.compiled.seed_library import SeedLibrary
from maira_qp.solvers.reference import levenberg_marquardt as descent
from maira_qp.solvers.reference import null_space_sqp as settling

if TYPE_CHECKING:
    from typing import Self  # not in Python 3.10

EXACT = 1e-12
"""Errors [m, rad] at which a descent that is to be exact ends."""

LEAST_EXACT_DAMPING = 1e-14
"""Its `LEAST_DAMPING`, at the edge of rounding: more would slow it down where singular values are as small."""


class PostureArrays(NamedTuple):
    """A redundancy that the kernels know: `1/2 sum_i weights_i (q_i - reference_i)^2`."""

    reference: np.ndarray
    """(n,)"""
    weights: np.ndarray
    """(n,)"""
    share: float | None
    """Weight of the objective in `Weighted`; None: `Strict`"""


def unsupported(problem: Problem) -> str:
    """Why the compiled engine cannot solve a problem, its additional limits aside; empty: it can."""
    if len(problem.tasks) != 1:
        return "it has more than one task" if problem.tasks else "its first level is switched off"
    robot, task = problem.robot, problem.tasks[0]
    if not isinstance(task, FrameTask) or task.target is not None:
        return "its task is none of PoseTask(), PositionTask() and OrientationTask() with a target from the call"
    if not task.is_even:
        return "the axes of its task count differently"
    if task.frame != robot.tip:
        return "its task is not the tip's"
    return "" if robot.is_chain else "the robot is no single chain of independent joints"


@dataclass(frozen=True)
class ProblemArrays:
    """The arrays of one problem, whose columns `kernels.layout` names."""

    problem: Problem
    chain: np.ndarray
    """(n + 1, 17)"""
    settings: np.ndarray
    """(16,) see `kernels.layout.Setting`"""
    seeds: SeedLibrary
    """Configurations to start from"""
    candidates: int
    """Random configurations of which a start is the best"""
    last_attempt: int
    redundancy: PostureArrays | None
    """None: there is none, or it is another than a posture with a weight for each joint"""
    settling: np.ndarray
    """(7,) see `kernels.layout.Settling`"""
    proofs: Proofs
    turns: WholeTurns | None
    """Counted to stay near the posture that is wished for, or the middle, where joints have a turn or more"""

    @classmethod
    def build(cls, problem: Problem) -> Self:
        """The arrays of a problem that is not `unsupported`."""
        robot, options = problem.robot, problem.options
        position_weight, orientation_weight = _weights(problem)
        settings = Setting.row(
            POSITION_WEIGHT=position_weight,
            ORIENTATION_WEIGHT=orientation_weight,
            POSITION_TOLERANCE=options.position_tolerance,
            ORIENTATION_TOLERANCE=options.orientation_tolerance,
            MAX_ITERATIONS=options.max_iterations,
            DAMPING=options.damping,
            STALL_STEPS=options.stall_steps,
            STALL_RATIO=options.stall_ratio,
            ACCEPTED=descent.ACCEPTED,
            REFUSED=descent.REFUSED,
            LEAST_FACTOR=descent.FACTOR_RANGE[0],
            MOST_FACTOR=descent.FACTOR_RANGE[1],
            LEAST_DAMPING=descent.LEAST_DAMPING,
            LONGEST=np.inf,
            NEAR=neighbourhood.NEAR,
            NEAR_BY_ERROR=neighbourhood.NEAR_BY_ERROR,
        )
        constants = Settling.row(
            MAX_SETTLING=options.max_settling,
            STATIONARITY_TOLERANCE=options.stationarity_tolerance,
            FIRST_RADIUS=settling.FIRST_RADIUS,
            LEAST_RADIUS=settling.LEAST_RADIUS,
            RESTORING=settling.RESTORING,
            RESTORED=settling.RESTORED,
            RESOLUTION=settling.RESOLUTION,
        )
        turns = problem.turns
        proofs = Proofs.build(problem)
        assert proofs is not None
        return cls(
            problem,
            _chain(robot.chain, turns.window),
            settings,
            SeedLibrary.build(robot, turns.window, settings, problem.posture),
            options.start_candidates,
            options.max_restarts,
            _posture_arrays(problem),
            constants,
            proofs,
            turns if turns.everywhere.any() else None,
        )

    def takes(self, starts: np.ndarray | None) -> bool:
        """Whether the kernels can begin there, at (n,) or (N, n): a continuous joint may have wound up too far."""
        return starts is None or bool(np.abs(starts).max(initial=0.0) <= FARTHEST_START)

    @property
    def robot(self) -> Robot:
        """The problem's robot."""
        return self.problem.robot

    @cached_property
    def n(self) -> int:
        """How many joints there are."""
        return self.problem.robot.n

    @cached_property
    def no_starts(self) -> np.ndarray:
        """Starts (0, n)"""
        return np.empty((0, self.n))

    @cached_property
    def farthest(self) -> float:
        """A coordinate of a target beyond this [m] is a mistake."""
        return FARTHEST * self.robot.length

    @cached_property
    def stationarity_tolerance(self) -> float:
        """Projected gradient below which a refinement is at an optimum."""
        return float(self.settling[Settling.STATIONARITY_TOLERANCE])

    @property
    def trades_off(self) -> bool:
        """There is a redundancy, and it is `Weighted` and costs the pose something."""
        return trades_off(self.problem.redundancy) and self.settles

    @property
    def posture(self) -> tuple[np.ndarray, np.ndarray]:
        """Reference (n,) and weights (n,) of the redundancy's objective."""
        assert self.redundancy is not None
        return self.redundancy[:2]

    @cached_property
    def has_turns(self) -> bool:
        """Some joint can stand at more than one turn."""
        span = (self.robot.upper - self.robot.lower)[~self.robot.slides]
        return bool((span > TURN + WITHIN).any())

    @property
    def settles(self) -> bool:
        """There is a redundancy, and the kernels know it."""
        return self.redundancy is not None

    def wish(self, q: np.ndarray) -> np.ndarray:
        """What the redundancy's objective is (N,) at configurations q (N, n), where the kernels know it; else 0."""
        if self.redundancy is None:
            return np.zeros(len(q))
        reference, weights = self.posture
        return 0.5 * np.square(q - reference) @ weights

    @cached_property
    def exact(self) -> Self:
        """The same with descents that do not end before the last digits, even next to a singularity."""
        settings = self.settings.copy()
        settings[[Setting.POSITION_TOLERANCE, Setting.ORIENTATION_TOLERANCE]] = EXACT
        settings[Setting.STALL_RATIO], settings[Setting.LEAST_DAMPING] = 0.0, LEAST_EXACT_DAMPING
        settings[Setting.MAX_ITERATIONS] = 1000
        return replace(self, settings=settings)

    def without_limits(self, joints: np.ndarray) -> Self:
        """The same with some joints (n,) of bool set free."""
        chain = self.chain.copy()
        chain[:-1, Joint.LOWER][joints], chain[:-1, Joint.UPPER][joints] = -np.inf, np.inf
        return replace(self, chain=chain)

    def of_problem(self, problem: Problem) -> Self:
        """The arrays of a problem of the same arm that is not `unsupported`, made of these where they fit."""
        if problem.robot is not self.problem.robot:
            return self.boxed(problem)
        before, after = (each.tasks[0].kept for each in (self.problem, problem))  # type: ignore[attr-defined]
        return self.with_problem(problem) if np.array_equal(before, after) else self.build(problem)

    def boxed(self, problem: Problem) -> Self:
        """The same for a problem of the arm with tighter limits; its seeds are those of the whole, clipped."""
        robot, turns, chain = problem.robot, problem.turns, self.chain.copy()
        chain[:-1, Joint.LOWER], chain[:-1, Joint.UPPER] = robot.lower, robot.upper
        chain[:-1, Joint.START_LOWER], chain[:-1, Joint.START_UPPER] = turns.window
        return replace(
            self,
            problem=problem,
            chain=chain,
            seeds=self.seeds.clipped(turns.window),
            proofs=self.proofs.boxed(problem, chain),
            turns=turns if turns.everywhere.any() else None,
        )

    def with_problem(self, problem: Problem) -> Self:
        """The same for a problem that differs in its redundancy, its restarts or the size of its weights."""
        settings, chain, turns = self.settings, self.chain, problem.turns
        weights = _weights(problem)
        if weights != (settings[Setting.POSITION_WEIGHT], settings[Setting.ORIENTATION_WEIGHT]):
            settings = settings.copy()
            settings[Setting.POSITION_WEIGHT], settings[Setting.ORIENTATION_WEIGHT] = weights
        if self.turns is not None or turns.long_slides.any():
            chain = _chain(chain, turns.window)
        return replace(
            self,
            problem=problem,
            chain=chain,
            settings=settings,
            seeds=self.seeds.changed(turns.window, settings, problem.posture),
            redundancy=_posture_arrays(problem),
            last_attempt=problem.options.max_restarts,
            turns=None if self.turns is None else turns,
        )


def _weights(problem: Problem) -> tuple[float, float]:
    """What position and orientation count."""
    weights = problem.tasks[0].all_weights  # type: ignore[attr-defined]
    return float(weights[0]), float(weights[5])


def _chain(chain: np.ndarray, window: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """A chain (n + 1, 17) whose starts are drawn between (n,) and (n,)."""
    chain = chain.copy()
    chain[:-1, Joint.START_LOWER], chain[:-1, Joint.START_UPPER] = window
    return chain


def _posture_arrays(problem: Problem) -> PostureArrays | None:
    """The redundancy as the kernels know it, if they do."""
    redundancy = problem.redundancy
    if redundancy is None or problem.hierarchy.lower or len(redundancy.objectives) > 1:
        return None
    objective = next(iter(redundancy.objectives))
    if not isinstance(objective, (Posture, LimitDistance)):
        return None
    posture = objective if isinstance(objective, Posture) else objective.as_posture
    if not posture.is_diagonal:
        return None
    share = None if isinstance(redundancy, Strict) else float(redundancy.weight)
    return PostureArrays(np.ascontiguousarray(posture.q_ref), np.ascontiguousarray(posture.weights), share)
