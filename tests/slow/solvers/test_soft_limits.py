"""A limit as the only task of the first level: below it the posture is optimal, in a solve and after ticks.

Against sequential quadratic programming by scipy, from what was found: it finds nothing better near.
"""

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.optimize import minimize
from support.robots import load

import maira_qp as mq


@dataclass(frozen=True)
class Below(mq.Limit):
    """The tool stays below a height [m]."""

    height: float

    def rows(self, at, tick):
        """One row: the tool rises by no more than what is left."""
        return at.jacobian()[2:3], np.array([self.height - at.placement().translation[2]])

    def violation(self, at):
        """By how much it is too high [m]."""
        return max(0.0, float(at.placement().translation[2]) - self.height)


def robot_of(name: str) -> mq.Robot:
    return mq.Robot.maira() if name == "maira" else load(name)


def best_near(robot: mq.Robot, q: np.ndarray, q_ref: np.ndarray, height: float) -> float:
    """The least `1/2 |q - q_ref|^2` that scipy finds from q (n,) with the tool below the height."""
    found = minimize(
        lambda q: 0.5 * (q - q_ref) @ (q - q_ref),
        q,
        jac=lambda q: q - q_ref,
        bounds=list(zip(robot.lower, robot.upper, strict=True)),
        constraints={
            "type": "ineq",
            "fun": lambda q: height - robot.forward(q).translation[2],
            "jac": lambda q: -robot.jacobian(q)[2],
        },
        method="SLSQP",
        options={"ftol": 1e-12, "maxiter": 300},
    )
    assert robot.forward(found.x).translation[2] <= height + 1e-6
    return float(found.fun)


@pytest.mark.parametrize("name", ["maira", "ur5", "panda"])
def test_below_a_limit_as_the_only_task_the_posture_is_optimal(name, rng):
    robot = robot_of(name)
    q_ref = robot.clip(robot.middle + 0.5 * rng.normal(size=robot.n))
    height = robot.forward(q_ref).translation[2] - 0.3
    task, binding = mq.LimitTask(limit=Below(height)), 0
    solver = mq.Solver(robot, task=task, redundancy=mq.Strict(mq.Posture(q_ref)))
    for k in range(4):
        q = robot.clip(q_ref + rng.normal(size=robot.n)) if k else None
        s = solver.solve(None, q)
        assert s.success
        assert s.optimal
        assert robot.forward(s.q).translation[2] <= height + 1e-6
        assert s.cost == pytest.approx(best_near(robot, s.q, q_ref, height), abs=1e-5)
        binding += s.cost > 1e-3
        q = s.q + 0.3 * rng.normal(size=robot.n)
        q = robot.clip(q)
        for _ in range(150):
            t = solver.step(q, None, 0.05)
            q = t.q
        assert np.abs(t.velocity).max() < 1e-6
        assert robot.forward(q).translation[2] <= height + 1e-6
        cost = 0.5 * (q - q_ref) @ (q - q_ref)
        assert cost <= best_near(robot, q, q_ref, height) + 1e-5
    assert binding >= 3
