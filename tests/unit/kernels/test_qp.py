"""Box QPs by their optimality conditions, one at a time and eight: each lane as if it were alone."""

import numpy as np
import pytest
from support.box_qps import solve_eight
from support.compiled_problems import few

from maira_qp.kernels.jit.simd import LANES
from maira_qp.kernels.qp.box_qp import BLOCK_PASSES, solve_box_qp
from maira_qp.problem.qp.backends import Backend
from maira_qp.problem.qp.qp import QP, QPSolution


def solve_one(H, c, lower, upper) -> tuple[np.ndarray, bool]:
    n = len(c)
    x = np.full(n, np.nan)
    found = solve_box_qp(
        H, c, lower, upper, np.full((n, n), np.nan), np.full(n, -7), np.full(n, -7), np.full(n, np.nan), x
    )
    return x, bool(found)


def random_problem(n: int, rng, least: float = 1e-3, *, any_slope: bool | None = None):
    """Tight, wide, infinite, one-sided and empty boxes; 0 at a bound or not; H = J^T J + a little of I.

    c is any, or, of many variables, one that a pose error makes, J^T e.
    """
    J = rng.normal(size=(6, n))
    H = J.T @ J + 10 ** rng.uniform(np.log10(least), 0) * np.eye(n)
    c = rng.normal(size=n) if (n <= 12 if any_slope is None else any_slope) else J.T @ rng.normal(size=6)
    c *= 10 ** rng.uniform(-8, 1)
    size = 10 ** rng.uniform(-3, 1)
    lower, upper = -size * rng.random(n), size * rng.random(n)
    lower[rng.random(n) < 0.2] = 0.0
    upper[rng.random(n) < 0.2] = 0.0
    upper[rng.random(n) < 0.2] = np.inf
    lower[rng.random(n) < 0.1] = -np.inf
    return H, c, lower, upper


def assert_optimal(H, c, lower, upper, x, within: float = 1e-10) -> None:
    """In the box to the bit, and the gradient zero but where a bound holds it."""
    assert (x >= lower).all()
    assert (x <= upper).all()
    n, g = len(c), H @ x + c
    z = np.where(x == lower, -np.maximum(g, 0), 0) + np.where(x == upper, np.maximum(-g, 0), 0)
    solution = QPSolution(QP(H, c, lower, upper, np.empty((0, n)), np.empty(0)), True, x, np.empty(0), z)
    assert solution.dual_residual() <= within * (np.abs(c).max() + np.abs(H).max() * np.abs(x).max())


def passes(H, c, lower, upper) -> int:
    """How many passes block principal pivoting takes from all variables free; at most 100: the kernels' slow twin."""
    side = np.where(lower < upper, 0, -1)
    for count in range(1, 100):
        x = np.where(side < 0, lower, upper)
        free, bound = side == 0, side != 0
        x[free] = np.linalg.solve(H[np.ix_(free, free)], -c[free] - H[np.ix_(free, bound)] @ x[bound])
        held = bound & (lower < upper) & (side * (H @ x + c) > 1e-13 * (np.abs(c) + np.abs(H) @ np.abs(x)))
        now = np.where(free & (x < lower), -1, np.where(free & (x > upper), 1, np.where(held, 0, side)))
        if (now == side).all():
            return count
        side = now
    return 100


def cycling_problem(n: int, rng):
    """One in which block pivoting does not come to an end in the passes that the kernels give it."""
    while True:
        J = rng.normal(size=(6, n))
        H, c = J.T @ J + 1e-4 * np.eye(n), J.T @ rng.normal(size=6)
        lower, upper = -rng.random(n), rng.random(n)
        if passes(H, c, lower, upper) > BLOCK_PASSES:
            return H, c, lower, upper


@pytest.mark.parametrize("n", [1, 2, 7, 12, 30])
def test_a_solution_satisfies_the_optimality_conditions(n, rng):
    """Lanes with different active sets, and the same problems one at a time."""
    for _ in range(few(60)):
        problems = [random_problem(n, rng, 1e-8 if n <= 7 else 1e-3) for _ in range(LANES)]
        x, definite = solve_eight(problems)
        assert definite.all()
        for lane, problem in enumerate(problems):
            assert_optimal(*problem, x[lane])
            alone, found = solve_one(*problem)
            assert found
            assert_optimal(*problem, alone)


@pytest.mark.parametrize("n", [1, 2, 7, 12, 30])
def test_lanes_one_at_a_time_and_a_backend_agree(n, rng):
    backend = Backend("daqp")
    for _ in range(few(20)):
        problems = [random_problem(n, rng) for _ in range(LANES)]
        x, _ = solve_eight(problems)
        for lane, (H, c, lower, upper) in enumerate(problems):
            scale = np.abs(c).max() / np.linalg.eigvalsh(H)[0]
            expected = backend.solve(QP(H, c, lower, upper, np.empty((0, n)), np.empty(0))).x
            assert np.abs(x[lane] - solve_one(H, c, lower, upper)[0]).max() < 1e-11 * scale
            assert np.abs(x[lane] - expected).max() < 1e-8 * scale


@pytest.mark.parametrize("n", [7, 12])
def test_problems_whose_passes_would_go_in_circles_are_solved_all_the_same(n, rng):
    """In one lane among easy ones, in several lanes, and by the kernel for one problem."""
    for _ in range(few(20)):
        hard = rng.random(LANES) < rng.choice([0.1, 0.5])
        hard[rng.integers(LANES)] = True
        problems = [cycling_problem(n, rng) if h else random_problem(n, rng) for h in hard]
        x, definite = solve_eight(problems)
        assert definite.all()
        for lane, problem in enumerate(problems):
            assert_optimal(*problem, x[lane], 1e-9)
            by_one, found = solve_one(*problem)
            assert found
            assert_optimal(*problem, by_one, 1e-9)


def test_with_a_diagonal_matrix_each_variable_is_clipped_alone(rng):
    for _ in range(few(100)):
        H = np.diag(rng.random(7) + 0.1)
        problems = [(H, rng.normal(size=7), -rng.random(7), rng.random(7)) for _ in range(LANES)]
        x, _ = solve_eight(problems)
        for lane, (_, c, lower, upper) in enumerate(problems):
            np.testing.assert_allclose(x[lane], np.clip(-c / np.diag(H), lower, upper), rtol=1e-15)


def spoilt_problem(kind: str, n: int, rng):
    """One whose matrix is not positive definite, or that has NaN in it."""
    H, c, lower, upper = random_problem(n, rng)
    wide = np.full(n, 1e3)
    if kind == "indefinite":
        return H - 100 * np.eye(n), c, -wide, wide
    if kind == "indefinite with a tight box":  # definite where enough variables stand on a bound
        H = rng.normal(size=(n, n))
        return H + H.T - np.diag(3 * (np.arange(n) == 0)), rng.normal(size=n), -np.full(n, 0.1), np.full(n, 0.1)
    if kind == "zero":
        return 0 * H, c, -wide, wide
    return (H + np.nan, c, lower, upper) if kind == "NaN in H" else (H, c + np.nan, lower, upper)


@pytest.mark.parametrize("kind", ["indefinite", "indefinite with a tight box", "zero", "NaN in H", "NaN in c"])
def test_a_spoilt_problem_is_told_and_disturbs_no_other_lane(kind, rng):
    """To the bit: the others are what they are without it."""
    n = 7
    for _ in range(few(60)):
        problems = [random_problem(n, rng) for _ in range(LANES)]
        x, definite = solve_eight(problems)
        assert definite.all()
        spoilt = rng.random(LANES) < 0.3
        spoilt[rng.integers(LANES)] = True
        with_spoilt = [spoilt_problem(kind, n, rng) if bad else p for bad, p in zip(spoilt, problems, strict=True)]
        again, definite = solve_eight(with_spoilt)
        assert (definite == ~spoilt).all()
        assert (again[~spoilt] == x[~spoilt]).all()
        for bad, problem in zip(spoilt, with_spoilt, strict=True):
            if bad and kind != "NaN in c":  # one problem alone is told by its matrix only
                assert not solve_one(*problem)[1]


@pytest.mark.parametrize("n", [2, 7, 12])
def test_the_solution_of_a_lane_depends_on_that_lane_alone(n, rng):
    """To the bit, whatever the others hold and in whichever lane it is: easy, locked, in circles, spoilt ones."""
    for _ in range(few(30)):
        problems = [random_problem(n, rng) for _ in range(LANES)]
        problems[1] = spoilt_problem("indefinite", n, rng)
        problems[2] = spoilt_problem("NaN in H", n, rng)
        problems[6] = spoilt_problem("indefinite with a tight box", n, rng)
        problems[3] = (*problems[3][:2], np.ones(n), np.ones(n))
        if n > 2:
            problems[4], problems[5] = cycling_problem(n, rng), cycling_problem(n, rng)
        x, definite = solve_eight(problems)
        for _ in range(5):
            order = rng.integers(0, LANES, LANES)
            again, definite_again = solve_eight([problems[k] for k in order])
            assert (definite_again == definite[order]).all()
            told = definite[order]
            assert (again[told] == x[order][told]).all()


@pytest.mark.parametrize("n", [1, 7])
def test_locked_variables_stay_where_they_are_and_the_others_do_their_best(n, rng):
    """Other ones in every lane, all of them in one; also at bounds that are infinite for the rest."""
    for _ in range(few(60)):
        problems = []
        for lane in range(LANES):
            H, c, lower, upper = random_problem(n, rng)
            locked = rng.random(n) < (1.0 if lane == 0 else 0.4)
            at = rng.normal(size=n) * (lane != 1)
            lower[locked] = upper[locked] = at[locked]
            problems.append((H, c, lower, upper))
        x, definite = solve_eight(problems)
        assert definite.all()
        for lane, (H, c, lower, upper) in enumerate(problems):
            locked = lower == upper
            assert (x[lane][locked] == lower[locked]).all()
            assert_optimal(H, c, lower, upper, x[lane])
            assert_optimal(H, c, lower, upper, solve_one(H, c, lower, upper)[0])


@pytest.mark.parametrize("n", [1, 7, 30])
def test_without_bounds_it_is_a_linear_system(n, rng):
    for _ in range(few(20)):
        J = rng.normal(size=(LANES, n, n))
        H, c, no = J.swapaxes(1, 2) @ J + np.eye(n), rng.normal(size=(LANES, n)), np.full(n, np.inf)
        x, _ = solve_eight([(H[k], c[k], -no, no) for k in range(LANES)])
        expected = np.linalg.solve(H, -c[..., None])[..., 0]
        assert np.abs(x - expected).max() < 1e-12
        assert np.abs(solve_one(H[0], c[0], -no, no)[0] - expected[0]).max() < 1e-12


def test_with_many_variables_and_any_slope_the_solution_is_in_the_box_whether_its_lane_settled_or_not(rng):
    """Most do; one problem alone always does."""
    settled = []
    for _ in range(few(20)):
        problems = [random_problem(30, rng, any_slope=True) for _ in range(LANES)]
        x, definite = solve_eight(problems)
        assert definite.all()
        for lane, (H, c, lower, upper) in enumerate(problems):
            assert (x[lane] >= lower).all()
            assert (x[lane] <= upper).all()
            by_one, found = solve_one(H, c, lower, upper)
            assert found
            assert_optimal(H, c, lower, upper, by_one)
            settled.append(np.abs(x[lane] - by_one).max() < 1e-9 * (1 + np.abs(by_one).max()))
    assert np.mean(settled) > 0.9


def test_a_nearly_singular_qp_with_many_variables_still_descends_inside_its_box(rng):
    n = 30
    for _ in range(few(40)):
        problems = []
        for _ in range(LANES):
            J = rng.normal(size=(6, n))
            problems.append((J.T @ J + 1e-9 * np.eye(n), J.T @ rng.normal(size=6), -rng.random(n), rng.random(n)))
        x, definite = solve_eight(problems)
        assert definite.all()
        for lane, (H, c, lower, upper) in enumerate(problems):
            for each in (x[lane], solve_one(H, c, lower, upper)[0]):
                assert (each >= lower).all()
                assert (each <= upper).all()
                assert 0.5 * each @ H @ each + c @ each < 0
