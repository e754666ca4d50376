"""The strict hierarchy: no level is felt by the ones above it, whatever limits are active."""

from dataclasses import replace

import numpy as np
import pytest
import qpsolvers

from maira_qp.problem.limits.joint import Bounds
from maira_qp.problem.qp.backends import Backend
from maira_qp.problem.qp.hierarchy import (
    RANK_THRESHOLD,
    Level,
    convexified,
    null_space,
    projected_gradient,
    solve_each_level,
    solve_hierarchy,
)

DAQP = Backend("daqp")


def box(lower, upper) -> Bounds:
    n = len(lower)
    return Bounds(np.array(lower, dtype=float), np.array(upper, dtype=float), np.empty((0, n)), np.empty(0))


def least_squares(J, e, damping=1e-9) -> Level:
    return Level(J.T @ J + damping * np.eye(J.shape[1]), -J.T @ e, J)


def tight_step(robot, rng):
    """Jacobian, error and box of a step with most joints at or near a limit."""
    q = robot.random_configuration(rng)
    lower, upper = robot.lower - q, robot.upper - q
    for i in range(robot.n):
        kind = rng.integers(12)
        near = rng.choice([0.0, 1e-12, 1e-9, 1e-6, 1e-3])
        if kind in (0, 1):
            upper[i] = near
        elif kind in (2, 3):
            lower[i] = -near
        elif kind == 4:
            lower[i], upper[i] = -near, near
    J = robot.jacobian(q)
    if rng.random() < 0.2:  # near a singularity
        J[rng.integers(6)] *= 10 ** rng.uniform(-12, -3)
    return J, rng.normal(size=6) * 10 ** rng.uniform(-3, 0), box(lower, upper), robot.middle - q


def test_level_2_never_changes_the_residual_of_level_1(maira, panda, rng):
    """1,500 random steps with joints at, near and between their limits: J dq is that of level 1 alone, to 1e-9."""
    worst = 0.0
    moved = 0
    for k in range(1_500):
        robot = maira if k % 2 else panda
        J, e, bounds, toward = tight_step(robot, rng)
        pose, posture = least_squares(J, e), Level(np.eye(robot.n), -toward, np.eye(robot.n))
        alone = solve_hierarchy([pose], bounds, DAQP)
        both = solve_hierarchy([pose, posture], bounds, DAQP)
        assert (both >= bounds.lower).all()
        assert (both <= bounds.upper).all()
        worst = max(worst, float(np.abs(J @ (both - alone)).max()))
        moved += bool(np.abs(both - alone).max() > 1e-3)
    assert worst <= 1e-9
    assert moved > 150  # the posture had something to do


def test_a_posture_projected_into_the_null_space_inside_one_qp_does_change_it(maira, rng):
    """The rival method fails the test above in many steps, so the test can fail."""
    spoiled = 0
    for _ in range(300):
        J, e, bounds, toward = tight_step(maira, rng)
        N = np.eye(maira.n) - np.linalg.pinv(J) @ J
        H = J.T @ J + 1e-2 * N.T @ N + 1e-9 * np.eye(maira.n)
        one = solve_hierarchy([Level(H, -J.T @ e - 1e-2 * N.T @ toward, J)], bounds, DAQP)
        alone = solve_hierarchy([least_squares(J, e)], bounds, DAQP)
        spoiled += bool(np.abs(J @ (one - alone)).max() > 1e-9)
    assert spoiled > 100


@pytest.mark.parametrize("name", ["daqp", "proxqp", "osqp", "piqp", "clarabel"])
def test_every_backend_keeps_the_hierarchy_with_several_redundant_degrees(name, rng):
    """Three levels of 2 + 3 + n rows in 9 joints: lower levels are QPs in several variables with rows."""
    backend = Backend(name)
    for _ in range(60):
        J1, J2 = rng.normal(size=(2, 9)), rng.normal(size=(3, 9))
        levels = [
            least_squares(J1, rng.normal(size=2)),
            least_squares(J2, 3 * rng.normal(size=3)),
            Level(np.eye(9), rng.normal(size=9), np.eye(9)),
        ]
        lower, upper = -rng.uniform(0, 1, 9), rng.uniform(0, 1, 9)
        lower[rng.random(9) < 0.3] = 0
        bounds = box(lower, upper)
        one, two, three = solve_each_level(levels, bounds, backend)[0]
        assert np.abs(J1 @ (two - one)).max() <= 1e-9
        assert np.abs(J1 @ (three - one)).max() <= 1e-9
        assert np.abs(J2 @ (three - two)).max() <= 1e-9
        assert (three >= lower).all()
        assert (three <= upper).all()


def test_a_careless_backend_costs_optimality_but_neither_limits_nor_hierarchy(rng):
    careless = Backend("osqp", {"eps_abs": 1e-2, "eps_rel": 1e-2})
    for _ in range(100):
        J1 = rng.normal(size=(3, 8))
        pose, posture = least_squares(J1, 3 * rng.normal(size=3)), Level(np.eye(8), 3 * rng.normal(size=8), np.eye(8))
        bounds = box(-rng.uniform(0, 1, 8), rng.uniform(0, 1, 8))
        one, two = solve_each_level([pose, posture], bounds, careless)[0]
        assert (two >= bounds.lower).all()
        assert (two <= bounds.upper).all()
        assert np.abs(J1 @ (two - one)).max() <= 1e-9


def test_level_2_is_optimal_among_all_that_level_1_allows(maira, rng):
    """Against a second formulation: one QP with J dq = J dq1 as equality rows."""
    compared = 0
    for k in range(200):
        n = 7 if k % 2 else 10
        J = maira.jacobian(maira.random_configuration(rng)) if n == 7 else rng.normal(size=(6, n))
        bounds = box(-rng.uniform(0, 0.5, n), rng.uniform(0, 0.5, n))
        g = rng.normal(size=n)
        pose, posture = least_squares(J, rng.normal(size=6)), Level(np.eye(n), g, np.eye(n))
        one, two = solve_hierarchy([pose], bounds, DAQP), solve_hierarchy([pose, posture], bounds, DAQP)
        reference = qpsolvers.solve_qp(
            np.eye(n), g, A=J, b=J @ one, lb=bounds.lower, ub=bounds.upper, solver="proxqp", eps_abs=1e-8, eps_rel=0.0
        )
        if reference is None:
            continue
        compared += 1
        value = [0.5 * x @ x + g @ x for x in (two, reference)]
        assert value[0] <= value[1] + 1e-6
    assert compared > 100


def test_rows_of_coupled_limits_hold_at_every_level(rng):
    for _ in range(200):
        J, G = rng.normal(size=(3, 8)), rng.normal(size=(2, 8))
        bounds = Bounds(-np.ones(8), np.ones(8), G, rng.uniform(0, 0.2, 2))
        pose, posture = least_squares(J, rng.normal(size=3)), Level(np.eye(8), 3 * rng.normal(size=8), np.eye(8))
        one, two = solve_hierarchy([pose], bounds, DAQP), solve_hierarchy([pose, posture], bounds, DAQP)
        for dq in (one, two):
            assert (G @ dq <= bounds.h + 1e-9).all()
        assert np.abs(J @ (two - one)).max() <= 1e-9


def test_locked_joints_leave_the_problem(maira, rng):
    J = maira.jacobian(maira.random_configuration(rng))
    lower, upper = -np.ones(7), np.ones(7)
    lower[[1, 4]] = upper[[1, 4]] = 0.0
    dq = solve_hierarchy(
        [least_squares(J, rng.normal(size=6)), Level(np.eye(7), np.ones(7), np.eye(7))], box(lower, upper), DAQP
    )
    assert dq[1] == dq[4] == 0.0
    assert np.abs(dq).max() > 0
    locked = solve_hierarchy([least_squares(J, np.ones(6))], box(np.zeros(7), np.zeros(7)), DAQP)
    assert np.array_equal(locked, np.zeros(7))


@pytest.mark.parametrize(("factor", "dimension"), [(0.1, 2), (10.0, 1)])
def test_the_rank_threshold_divides_where_it_says(factor, dimension, rng):
    """On either side of the threshold the basis is orthonormal, and what it lets through is below the threshold."""
    U, V = (np.linalg.qr(rng.normal(size=(k, k)))[0] for k in (6, 7))
    s = np.array([2.0, 1, 1, 1, 1, 2.0 * factor * RANK_THRESHOLD])
    A = U @ np.hstack([np.diag(s), np.zeros((6, 1))]) @ V.T
    Z = null_space(A)
    assert Z.shape == (7, dimension)
    assert np.abs(Z.T @ Z - np.eye(dimension)).max() < 1e-14
    assert np.abs(A @ Z).max() < 4 * RANK_THRESHOLD


def test_a_level_that_says_nothing_new_takes_no_freedom(rng):
    """Three levels in six joints, the second the first once more: the third moves as if it were not there."""
    J1, J3 = rng.normal(size=(3, 6)), rng.normal(size=(3, 6))
    bounds = box(-np.ones(6), np.ones(6))
    first, last = least_squares(J1, 0.1 * rng.normal(size=3)), least_squares(J3, 0.1 * rng.normal(size=3))
    again = least_squares(rng.normal(size=(3, 3)) @ J1, rng.normal(size=3))
    _, _, with_it = solve_each_level([first, again, last], bounds, DAQP)[0]
    _, without = solve_each_level([first, last], bounds, DAQP)[0]
    assert np.abs(with_it - without).max() < 1e-9


def test_degenerate_null_spaces():
    assert null_space(np.empty((0, 4))).shape == (4, 4)
    assert null_space(np.zeros((6, 4))).shape == (4, 4)
    assert null_space(np.eye(4)).shape == (4, 0)


def test_the_positive_part_keeps_positive_matrices_and_mends_the_rest(rng):
    A = rng.normal(size=(5, 5))
    assert np.allclose(convexified(A @ A.T), A @ A.T)
    mended = convexified(A + A.T)
    assert np.linalg.eigvalsh(mended).min() > 0
    assert np.allclose(np.linalg.eigvalsh(mended)[-1], np.abs(np.linalg.eigvalsh(A + A.T)).max())
    assert convexified(np.array([[-2.0]])) == 2.0


def test_the_projected_gradient_vanishes_exactly_where_limits_or_rows_hold_the_gradient():
    g, none = np.array([1.0, -2.0, 0.0]), ()
    wide = box([-1, -1, -1], [1, 1, 1])
    assert projected_gradient(g, none, wide, DAQP) == pytest.approx(2.0)
    assert projected_gradient(g, none, box([0, -1, -1], [1, 0, 1]), DAQP) == 0.0
    assert projected_gradient(g, none, box([-1, -1, -1], [0, 0, 1]), DAQP) == pytest.approx(1.0)
    assert projected_gradient(g, [least_squares(g[None], np.zeros(1))], wide, DAQP) < 1e-12
    # the row x1 + x2 = const leaves the direction (1, -1) / sqrt 2, along which the gradient is 3 / sqrt 2
    assert projected_gradient(
        g, [least_squares(np.array([[1.0, 1, 0], [0, 0, 1]]), np.zeros(2))], wide, DAQP
    ) == pytest.approx(1.5)
    # a limit that is near but not reached does not hold it up
    assert projected_gradient(g, none, box([-1e-6, -1e-6, -1], [1e-6, 1e-6, 1]), DAQP) >= 1e-3


def test_where_a_backend_finds_no_point_a_lower_level_is_solved_all_the_same(rng):
    """In corners of limits, where z = 0 is feasible: as good as where the backend answers."""

    class Silent(Backend):
        def solve(self, qp):
            return replace(super().solve(qp), found=not len(qp.h))

    for _ in range(20):
        n = 7
        J, A = rng.normal(size=(3, n)), rng.normal(size=(n, n))
        bounds = Bounds(-rng.random(n), rng.random(n) * (rng.random(n) < 0.5), np.empty((0, n)), np.empty(0))
        levels = [Level(J.T @ J + 1e-3 * np.eye(n), rng.normal(size=n), J), Level(A @ A.T, rng.normal(size=n), A[:0])]
        (_, alone), solved = solve_each_level(levels, bounds, Silent("daqp"))
        (_, asked), _ = solve_each_level(levels, bounds, DAQP)
        assert solved
        np.testing.assert_allclose(alone, asked, rtol=0, atol=1e-7)


def test_friction_holds_a_level_up_whose_gradient_is_small_and_no_other(rng):
    """Steep and flat directions: `c + H s + still s / |s| = 0` for its step s; none where |c| is below still."""
    wide = Bounds(-np.full(4, np.inf), np.full(4, np.inf), np.empty((0, 4)), np.empty(0))
    for _ in range(200):
        Q, curvature = np.linalg.qr(rng.normal(size=(4, 4)))[0], 10.0 ** rng.uniform(-6, 0, 4)
        H, c = (Q * curvature) @ Q.T, Q @ (rng.normal(size=4) * 10.0 ** rng.uniform(-9, -3, 4))
        still = float(np.linalg.norm(c)) * 10.0 ** rng.uniform(-3, 0.5)
        (step,), _ = solve_each_level([Level(H, c, H[:0], still=still)], wide, DAQP)
        size, slope = float(np.linalg.norm(step)), float(np.linalg.norm(c))
        if size == 0.0:
            assert slope <= 1.5 * still
            continue
        assert slope >= still
        rest = c + H @ step + still * step / size
        assert np.linalg.norm(rest) <= 0.15 * still + 0.02 * slope
