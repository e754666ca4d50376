"""The walks of eight targets at once: those of a plain one after the other, and to optima by another measure."""

from __future__ import annotations

import numpy as np
import pytest
from support.box_qps import solve_eight
from support.compiled_problems import arm, few, reachable_rows
from support.redundancy_problems import STATIONARY, Problem, reached_starts

import maira_qp as mq
from maira_qp.kernels.jit.simd import LANES
from maira_qp.kernels.layout import Refinement
from maira_qp.kernels.refinement.stabilized_sqp_simd import (
    FIRST_DAMPING,
    LEAST_DAMPING,
    LESS_DAMPING,
    MORE_DAMPING,
    MOST_CHANGE,
    MOST_STEPS,
    PENALTY,
    SMALL_WEIGHT,
    make_walks,
    walk_in_lanes,
)
from maira_qp.problem.redundancy import Strict
from maira_qp.solvers.reference.null_space_sqp import FIRST_RADIUS, LEAST_RADIUS, RESOLUTION, RESTORED


def walks(problem: Problem, rows: np.ndarray, starts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """q (N, n) and steps (N,) of the kernel."""
    arrays, q, outcome = problem.arrays, starts.copy(), np.full((len(rows), Refinement.WIDTH), np.nan)
    own = (problem.reference, problem.weights, arrays.settling)
    work = make_walks(starts.shape[1]), np.empty(LANES, np.int64)
    walk_in_lanes(arrays.chain, arrays.settings, rows, *own, *work, q, outcome)
    return q, outcome[:, Refinement.ITERATIONS]


class PlainWalk:
    """The slow twin: the method as the kernel's docstring has it, for one target, on the reference engine's terms."""

    def __init__(self, problem: Problem, row: np.ndarray, start: np.ndarray) -> None:
        self.robot, self.reference, self.weights = problem.robot, problem.reference, problem.weights
        self.cost, self.scale, self.W = problem.cost(row), problem.weights.mean(), problem.solver.tasks[0].weights
        self.q, self.y, self.radius, self.mu = start, np.zeros(6), FIRST_RADIUS, 0.0

    def error(self, q: np.ndarray) -> np.ndarray:
        """W e (6,)."""
        return self.cost.rows(self.robot.at(q))[1]

    def objective(self, q: np.ndarray) -> float:
        """f."""
        return 0.5 * float(self.weights @ (q - self.reference) ** 2)

    def gradient(self, q: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Of the Lagrangian f - y^T W e (n,)."""
        return self.weights * (q - self.reference) + (self.W[:, None] * self.robot.jacobian(q)).T @ y

    def left(self, q: np.ndarray, y: np.ndarray) -> float:
        """The largest entry of what the limits leave of the gradient."""
        step = np.clip(-1e-3 * self.gradient(q, y), self.robot.lower - q, self.robot.upper - q)
        return float(np.abs(step).max() / 1e-3)

    def merit(self, q: np.ndarray, y: np.ndarray) -> float:
        """The augmented Lagrangian."""
        r, penalty = self.error(q), PENALTY * (self.scale + np.abs(y).max())
        return self.objective(q) - y @ r + 0.5 * penalty * r @ r

    def qp(self) -> np.ndarray | None:
        """A step (n,), or None where the matrix is not positive."""
        A, weight, n = self.W[:, None] * self.robot.jacobian(self.q), SMALL_WEIGHT / self.scale, self.robot.n
        B = np.diag(self.weights) + self.robot.at(self.q).kinematic_hessian_product(None, self.W * self.y)
        H = A.T @ A + weight * (B + self.scale * self.mu * np.eye(n))
        c = -A.T @ self.error(self.q) + weight * self.gradient(self.q, self.y)
        lower = np.minimum(np.maximum(self.robot.lower - self.q, -self.radius), 0.0)
        upper = np.maximum(np.minimum(self.robot.upper - self.q, self.radius), 0.0)
        dq, positive = solve_eight([(H, c, lower, upper)] * LANES)
        return dq[0] if positive[0] else None

    def run(self) -> tuple[np.ndarray, int] | None:
        """Where it converges and after how many steps."""
        for step in range(1, MOST_STEPS + 1):
            dq = self.qp()
            if dq is None:
                self.mu = max(MORE_DAMPING * self.mu, FIRST_DAMPING)
                continue
            there = self.robot.clip(self.q + dq)
            A = self.W[:, None] * self.robot.jacobian(self.q)
            change = (A @ dq - self.error(self.q)) * self.scale / SMALL_WEIGHT
            y = self.y + change if np.abs(change).max() < MOST_CHANGE * self.scale else self.y
            costs = [0.5 * float(np.sum(self.error(q) ** 2)) for q in (self.q, there)]
            noise = RESOLUTION * (self.scale + self.objective(self.q) + np.abs(y).max())
            fell = self.merit(there, y) < self.merit(self.q, y) + noise
            halved = self.left(there, y) < 0.5 * self.left(self.q, self.y) and costs[1] < max(costs[0], RESTORED)
            longest = np.abs(there - self.q).max()
            if fell or halved:
                self.q, self.y, self.mu = there, y, LESS_DAMPING * self.mu
                self.radius *= 2.0 if longest > 0.9 * self.radius else 1.0
                if self.left(self.q, y) <= 0.5 * STATIONARY and costs[1] <= RESTORED:
                    return self.q, step
            else:
                self.radius = 0.25 * min(self.radius, longest)
            self.mu = 0.0 if self.mu < LEAST_DAMPING else self.mu
            if self.radius < LEAST_RADIUS:
                break
        return None


@pytest.mark.parametrize(
    "objective", [mq.Posture(), mq.LimitDistance()], ids=lambda objective: type(objective).__name__
)
@pytest.mark.parametrize("name", ["maira", "panda", "tiago", "ur5"])
def test_the_walks_are_those_of_the_plain_one(name, objective, rng):
    """Nearly all to the last step: where one is decided by rounding, the paths part."""
    robot, count = arm(name), few(20)
    problem = Problem(robot, Strict(objective))
    rows, starts = reached_starts(robot, rng, count)
    q, steps = walks(problem, rows, starts)
    same = 0
    for k, (row, start) in enumerate(zip(rows, starts, strict=True)):
        plain = PlainWalk(problem, row, start).run()
        if plain is None:
            same += np.array_equal(q[k], start)
        else:
            same += bool(np.abs(q[k] - plain[0]).max() < 1e-6 and abs(steps[k] - plain[1]) <= 1)
    assert same >= 0.95 * len(rows) - 1


@pytest.mark.parametrize("name", ["maira", "panda", "tiago"])
def test_nearly_all_walks_converge_and_soon_and_then_to_an_optimum(name, rng):
    robot = arm(name)
    problem = Problem(robot, Strict(mq.Posture()))
    rows, starts = reached_starts(robot, rng, few(400))
    q, steps = walks(problem, rows, starts)
    assert (q >= robot.lower).all()
    assert (q <= robot.upper).all()
    converged = (q != starts).any(axis=1)
    assert converged.mean() >= 0.95 - 1 / len(rows)
    assert steps.mean() < 10
    for k in np.flatnonzero(converged)[::20]:
        assert problem.left(rows[k], q[k]) <= STATIONARY
        assert problem.cost(rows[k]).value(robot.at(q[k])) <= 1.1 * RESTORED
        assert (
            problem.total(rows[k], q[k]) <= problem.total(rows[k], starts[k]) + 1e-2
        )  # the start may use its tolerance


@pytest.mark.parametrize("name", ["maira", "tiago"])
def test_what_a_walk_tells_bounds_what_is_left_of_the_gradient(name, rng):
    """With a coarse tolerance, so that something is left."""
    problem, some = Problem(arm(name), Strict(mq.Posture()), stationarity_tolerance=0.1), 0
    rows, starts = reached_starts(problem.robot, rng, few(60))
    q, outcome = problem.settle_all(rows, starts)
    for row, end, bound in zip(rows, q, outcome[:, Refinement.PROJECTED_GRADIENT], strict=True):
        left = problem.left(row, end)
        assert left <= 1.001 * bound + 1e-13
        some += left > 1e-12
    assert some > 0


def test_what_is_off_the_target_or_no_number_stays_and_disturbs_nobody(maira, rng):
    problem = Problem(maira, Strict(mq.Posture()))
    rows, starts = reached_starts(maira, rng, 12)
    alone = [walks(problem, rows[k : k + 1], starts[k : k + 1]) for k in range(len(rows))]
    rows, starts = np.repeat(rows, 2, axis=0), np.repeat(starts, 2, axis=0)
    rows[1::4], starts[3::4] = np.nan, np.nan
    rows[5] = reachable_rows(maira, rng, 1)[0]
    q, steps = walks(problem, rows, starts)
    assert np.array_equal(q[1::2], starts[1::2], equal_nan=True)
    assert np.array_equal(q[::2], np.concatenate([one[0] for one in alone]))
    assert np.array_equal(steps[::2], np.concatenate([one[1] for one in alone]))
