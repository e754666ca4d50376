"""One redundancy of a robot, for the kernels and for the reference engine."""

import numpy as np
import pytest

import maira_qp as mq
from maira_qp.kernels.layout import Refinement
from maira_qp.kernels.refinement.null_space_sqp import trade_off_each
from maira_qp.problem.objectives import Objective
from maira_qp.problem.qp.costs import TaskCost, WeightedCost
from maira_qp.problem.qp.hierarchy import projected_gradient
from maira_qp.problem.redundancy import Strict, Weighted
from maira_qp.problem.targets import pose_of
from maira_qp.solvers.compiled.refinement import settle
from maira_qp.solvers.reference.levenberg_marquardt import Budget
from maira_qp.solvers.reference.multi_start import stationarity
from maira_qp.solvers.reference.null_space_sqp import Settled
from maira_qp.solvers.reference.null_space_sqp import settle as settle_generally
from support.compiled_problems import compiled, reachable_rows, search_for

STATIONARY = 1e-6
"""`Options.stationarity_tolerance`."""


def settle_by_weight(arrays, rows, reference, weights, weight, q, outcome):
    """Both kernels: to the optimum of `Strict`, and where there is a weight from there to that of `Weighted`."""
    settle(arrays, (reference, weights), rows, q, outcome)
    if weight != 0.0:
        trade_off_each(arrays.chain, arrays.settings, rows, reference, weights, weight, arrays.settling, q, outcome)


class Problem:
    """One redundancy of a robot, for either engine."""

    def __init__(self, robot: mq.Robot, redundancy: Strict | Weighted, task=None, **options) -> None:
        solver = mq.Solver(robot, task=task, redundancy=redundancy, options=mq.Options(**options))
        self.solver = mq.Solver(robot, task=task, redundancy=redundancy, options=solver.options, backend="daqp")
        self.robot, self.redundancy, self.setting = robot, solver.redundancy, self.solver.engines.reference.context
        self.arrays = solver.engines.compiled
        self.reference, self.weights = self.arrays.posture
        self.weight = redundancy.weight if isinstance(redundancy, Weighted) else 0.0

    @property
    def objective(self) -> Objective:
        """The only one."""
        own = self.redundancy
        return own.objective if isinstance(own, Weighted) else own.objectives[0]

    def settle(self, row: np.ndarray, start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """q (n,) and outcome (6,) of the kernel."""
        q, outcome = self.settle_all(row[None], start[None])
        return q[0], outcome[0]

    def settle_all(self, rows: np.ndarray, starts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """q (N, n) and outcomes (N, 6) of the kernel for batches; inside the limits, what began there."""
        q, outcome, arrays = starts.copy(), np.full((len(rows), Refinement.WIDTH), np.nan), self.arrays
        settle_by_weight(arrays, rows, self.reference, self.weights, self.weight, q, outcome)
        numbers = np.isfinite(starts).all(axis=1)
        assert (q[numbers] >= self.robot.lower).all()
        assert (q[numbers] <= self.robot.upper).all()
        return q, outcome

    def cost(self, row: np.ndarray) -> TaskCost:
        """The task toward a target."""
        return TaskCost((self.solver.tasks[0].toward({self.robot.tip: pose_of(row)}),))

    def settle_generally(self, row: np.ndarray, start: np.ndarray) -> Settled:
        """The definition."""
        cost = self.cost(row)
        reached = self.solver.engines.reference.reached(cost)
        return settle_generally(self.redundancy, cost, self.robot.at(start), self.setting, Budget(None), reached)

    def left(self, row: np.ndarray, q: np.ndarray) -> float:
        """The projected gradient at q (n,) by the reference engine's own measure."""
        at, cost = self.robot.at(q), self.cost(row)
        if self.weight:
            return stationarity(WeightedCost(cost, self.objective, self.weight), at, self.setting)
        bounds = self.setting.bounds(at)
        return projected_gradient(self.objective.gradient(at), [cost.level(at)], bounds, self.setting.backend)

    def total(self, row: np.ndarray, q: np.ndarray) -> float:
        """What the redundancy makes small."""
        value = self.objective.cost(self.robot.at(q))
        return self.cost(row).value(self.robot.at(q)) + self.weight * value if self.weight else value

    def assert_told_as_it_is(self, row: np.ndarray, q: np.ndarray, outcome: np.ndarray) -> None:
        """The outcome by the reference engine: never a false optimum, and no optimum of Strict off the pose."""
        at, cost = self.robot.at(q), self.cost(row)
        position, orientation = cost.tasks[0].residual(at)
        assert bool(outcome[Refinement.REACHED]) == self.solver.engines.reference.reached(cost)(at)
        assert outcome[Refinement.POSITION_ERROR] == pytest.approx(position, abs=1e-13)
        assert outcome[Refinement.ORIENTATION_ERROR] == pytest.approx(orientation, abs=1e-13)
        assert outcome[Refinement.OBJECTIVE] == pytest.approx(self.objective.cost(at), rel=1e-12)
        left, told = self.left(row, q), outcome[Refinement.PROJECTED_GRADIENT]
        assert told == pytest.approx(left, rel=1e-3, abs=1e-8) or left <= told <= STATIONARY
        if not self.weight and outcome[Refinement.PROJECTED_GRADIENT] <= STATIONARY:
            assert outcome[Refinement.REACHED]


def reached_starts(robot: mq.Robot, rng, count: int, task=None) -> tuple[np.ndarray, np.ndarray]:
    """Poses (N, 12) and configurations (N, n) that reach them, as a search finds them."""
    rows = reachable_rows(robot, rng, count)
    q, outcome = search_for(compiled(robot, task), rows)
    found = outcome[:, 0] > 0
    return rows[found], q[found]
