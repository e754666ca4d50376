"""What the redundancy's kernels compute in null spaces: bases, multipliers, positive parts, QPs with a box's rows."""

import numpy as np
import pytest
from scipy.optimize import nnls
from support.compiled_problems import few, rubbish

from maira_qp.kernels.linalg.convexify import convexify
from maira_qp.kernels.linalg.ldl import factor_ldl, solve_ldl
from maira_qp.kernels.linalg.qr_null_space import balance, extend, factor, null_vector, shortest_solution
from maira_qp.kernels.linalg.symmetric_eigen import diagonalise
from maira_qp.kernels.qp.null_space_qp import ROW_QP, solve_row_qp
from maira_qp.kernels.refinement.feasibility_restoration import RANK_THRESHOLD
from maira_qp.problem.qp.backends import Backend
from maira_qp.problem.qp.hierarchy import RANK_THRESHOLD as THRESHOLD_OF_THE_HIERARCHY
from maira_qp.problem.qp.hierarchy import convexified, null_space
from maira_qp.problem.qp.qp import QP


class Factored:
    """The rows A (m, n) as the kernels factor them, in larger arrays than they need."""

    def __init__(self, A: np.ndarray, threshold: float = RANK_THRESHOLD) -> None:
        self.m, self.n = A.shape
        self.At = np.full((self.n + 2, self.m + 1), np.nan)
        self.At[: self.n, : self.m] = A.T
        self.tau, self.order = np.full(self.m, np.nan), np.full(self.m, -(2**62))
        self.rank = factor(self.At, self.n, self.m, threshold, self.tau, self.order)

    def basis(self) -> np.ndarray:
        """(n, n - rank)"""
        Z = np.full((self.n, self.n - self.rank), np.nan)
        for k in range(self.n - self.rank):
            x = np.full(self.n, np.nan)
            null_vector(self.At, self.n, self.rank, self.tau, k, x)
            Z[:, k] = x
        return Z

    def shortest(self, b: np.ndarray) -> np.ndarray:
        """The shortest x (n,) with A x = b."""
        x = np.full(self.n, np.nan)
        shortest_solution(self.At, self.n, self.rank, self.tau, self.order, b, x)
        return x

    def multipliers(self, g: np.ndarray, rank: int | None = None) -> np.ndarray:
        """Multipliers (m,) that balance g (n,)."""
        multipliers, rank = np.full(self.m, np.nan), self.rank if rank is None else rank
        balance(self.At, self.n, self.m, rank, self.tau, self.order, g.copy(), multipliers)
        return multipliers


def rows_of_rank(m: int, n: int, rank: int, rng) -> np.ndarray:
    return rng.normal(size=(m, rank)) @ rng.normal(size=(rank, n))


def with_singular_values(s, n: int, rng) -> np.ndarray:
    """Rows (m, n) with the singular values s (m,)."""
    U, V = (np.linalg.qr(rng.normal(size=(k, k)))[0] for k in (len(s), n))
    return U @ np.hstack([np.diag(s), np.zeros((len(s), n - len(s)))]) @ V.T


@pytest.mark.parametrize("n", [1, 2, 5, 6, 7, 8, 12, 30])
def test_the_basis_spans_the_null_space(n, rng):
    """Of full and of lower rank, with rows of zeros, and with none but those."""
    for _ in range(few(60)):
        rank = int(rng.integers(0, min(6, n) + 1))
        A = rows_of_rank(6, n, rank, rng) * 10 ** rng.uniform(-6, 6)
        if rank <= 3 and rng.random() < 0.5:
            A[3:] = 0.0
            rank = np.linalg.matrix_rank(A)
        factored = Factored(A)
        Z, expected = factored.basis(), null_space(A)
        assert factored.rank == rank
        assert np.abs(Z.T @ Z - np.eye(n - rank)).max(initial=0.0) < 1e-13
        assert np.abs(A @ Z).max(initial=0.0) <= 1e-13 * max(np.abs(A).max(), 1e-300)
        assert np.abs(Z @ Z.T - expected @ expected.T).max() < 1e-9


@pytest.mark.parametrize(("factor_of_it", "dimension"), [(0.05, 2), (20.0, 1)])
def test_the_rank_threshold_divides_where_it_says(factor_of_it, dimension, rng):
    for _ in range(few(200)):
        A = with_singular_values([2.0, 1, 1, 1, 1, 2.0 * factor_of_it * RANK_THRESHOLD], 7, rng)
        Z = Factored(A).basis()
        assert Z.shape == (7, dimension)
        assert np.abs(A @ Z).max() < 2.0 * RANK_THRESHOLD


def test_what_the_hierarchy_takes_for_a_null_space_is_one_here_too(rng):
    """So no projected gradient can be smaller than the reference engine's for want of a direction."""
    for _ in range(few(2000)):
        s = np.r_[10 ** -rng.uniform(0, 4, 5), 0.99 * THRESHOLD_OF_THE_HIERARCHY]
        s[0] = 1.0
        assert Factored(with_singular_values(s, 7, rng)).rank <= 5


@pytest.mark.parametrize("n", [3, 6, 7, 12])
def test_solutions_and_multipliers_are_those_of_least_squares(n, rng):
    for _ in range(few(60)):
        rank = int(rng.integers(1, min(6, n) + 1))
        A = rows_of_rank(6, n, rank, rng)
        factored, x, g = Factored(A), rng.normal(size=n), rng.normal(size=n)
        size = np.linalg.cond(A, 2) if rank == 6 else 1e4
        assert np.abs(factored.shortest(A @ x) - np.linalg.pinv(A, rcond=1e-10) @ A @ x).max() < 1e-13 * size**2
        left = g + A.T @ factored.multipliers(g)
        assert np.abs(A @ left).max() < 1e-12 * size  # nothing in reach of the rows is left
        assert np.abs(left - (g - np.linalg.pinv(A, rcond=1e-10) @ A @ g)).max() < 1e-12 * size


def test_near_a_singularity_a_lower_rank_keeps_multipliers_small(rng):
    A = with_singular_values([1, 1, 1, 1, 1, 1e-8], 7, rng)
    factored, g = Factored(A), rng.normal(size=7)
    assert factored.rank == 6
    assert np.abs(factored.multipliers(g)).max() > 1e5
    assert np.abs(factored.multipliers(g, rank=5)).max() < 1e2


def test_rows_with_nan_come_to_an_end():
    assert 0 <= Factored(np.full((6, 7), np.nan)).rank <= 6
    D, V = np.empty((4, 4)), np.empty((4, 4))
    assert not convexify(np.full((4, 4), np.nan), 4, D, V)


@pytest.mark.parametrize("k", [1, 2, 5, 12])
def test_systems_with_a_positive_matrix_are_solved(k, rng):
    for _ in range(few(50)):
        A = rng.normal(size=(k, k + 2))
        H, b, F = A @ A.T, rng.normal(size=k), np.full((k + 1, k + 1), np.nan)
        assert factor_ldl(H, k, 0.0, F)
        x = b.copy()
        solve_ldl(F, k, x)
        assert np.abs(H @ x - b).max() < 1e-12 * np.linalg.cond(H)
        assert not factor_ldl(H - (np.linalg.eigvalsh(H)[0] + 1e-9) * np.eye(k), k, 0.0, F)


@pytest.mark.parametrize("k", [1, 2, 4, 7, 20])
def test_the_positive_part_is_that_of_the_hierarchy(k, rng):
    """Positive, indefinite, negative and singular matrices, on all scales."""
    changed = 0
    for _ in range(few(60)):
        A = rng.normal(size=(k, k)) * 10 ** rng.uniform(-4, 4)
        H = [A @ A.T, A + A.T, -A @ A.T, A[:, : k // 2] @ A[:, : k // 2].T][rng.integers(4)]
        found, D, V = np.full((k + 1, k + 1), np.nan), np.full((k, k), np.nan), np.full((k, k), np.nan)
        found[:k, :k] = H
        was = convexify(found, k, D, V)
        changed += not was
        expected, size = convexified(H), max(np.abs(H).max(), 1e-12)
        assert np.abs(found[:k, :k] - (H if was else expected)).max() < 1e-12 * size * k
        if was:
            assert np.linalg.eigvalsh(H)[0] > 0
    assert changed > 0


@pytest.mark.parametrize("k", [1, 2, 3, 6, 14, 30])
def test_eigenvalues_and_vectors(k, rng):
    """Of matrices of any rank and scale, of blocks, with eigenvalues that are the same, and of none but zeros."""
    for case in range(few(60)):
        A = rng.normal(size=(k, k)) * 10 ** rng.uniform(-8, 8)
        A = A + A.T
        if case % 6 == 1:
            A = A[:, : k // 2] @ A[: k // 2]
            A = A + A.T
        if case % 6 == 2:
            A[: k // 2, k // 2 :], A[k // 2 :, : k // 2] = 0.0, 0.0
        if case % 6 == 3:
            A = np.diag(rng.integers(-1, 2, k).astype(float))
        D, V, size = np.full((k, k), np.nan), np.full((k, k), np.nan), max(np.abs(A).max(), 1e-300)
        diagonalise(A, k, D, V)
        assert np.abs(V.T @ np.diag(np.diag(D)) @ V - A).max() <= 1e-14 * k * size
        assert np.abs(np.sort(np.diag(D)) - np.linalg.eigvalsh(A)).max() <= 1e-14 * k * size
        assert np.abs(V @ V.T - np.eye(k)).max() <= 1e-14 * k


@pytest.mark.parametrize("n", [3, 7, 14])
def test_rows_that_are_factored_later_give_the_null_space_of_all(n, rng):
    """Also rows that depend on those before them, which count for nothing by their own size."""
    for _ in range(few(60)):
        first, second = rng.normal(size=(int(rng.integers(1, n)), n)), rng.normal(size=(3, n))
        second[0] = rng.normal(size=len(first)) @ first
        At, tau, order = np.full((n + 2, n + 4), np.nan), np.full(n + 4, np.nan), np.full(n + 4, -(2**62))
        At[:n, : len(first)] = first.T
        rank = factor(At, n, len(first), RANK_THRESHOLD, tau, order)
        assert rank == len(first)
        At[:n, rank : rank + 3] = second.T
        size = float(np.linalg.norm(second, axis=1).max())
        rank = extend(At, n, rank, rank + 3, RANK_THRESHOLD, size, tau, order)
        rows = np.vstack([first, second])
        assert rank == np.linalg.matrix_rank(rows)
        for k in range(n - rank):
            x = np.full(n, np.nan)
            null_vector(At, n, rank, tau, k, x)
            assert np.linalg.norm(x) == pytest.approx(1.0, abs=1e-13)
            assert np.abs(rows @ x).max() < 1e-12


def row_qp(H, c, Z, lower, upper) -> tuple[np.ndarray, np.ndarray, bool]:
    """z (k,), x (n,) and the verdict of `solve_row_qp`, in larger arrays than it needs."""
    n, k = Z.shape
    wide = np.full((n, n), np.nan)
    wide[:, :k] = Z
    tall = np.full((n, n), np.nan)
    tall[:k, :k] = H
    z, x = np.full(n, np.nan), np.full(n, np.nan)
    slope = np.r_[c, np.full(n - k, np.nan)]
    found = solve_row_qp(tall, slope, k, wide, lower, upper, *rubbish(ROW_QP, n), z, x)
    return z[:k], x, bool(found)


def random_row_qp(n: int, k: int, rng):
    """Rooms of many sizes, none and infinite ones among them; rows of zeros, and rows that say the same twice."""
    Z = np.linalg.qr(rng.normal(size=(n, k)))[0]
    if rng.random() < 0.3:
        Z[rng.integers(n)] = 0.0
    if rng.random() < 0.3:
        Z[rng.integers(n)] = rng.choice([-1, 1, 2]) * Z[rng.integers(n)]
    A = rng.normal(size=(k, k + 1))
    H = A @ A.T + 10 ** rng.uniform(-4, 0) * np.eye(k)
    lower, upper = -(10 ** rng.uniform(-3, 1)) * rng.random(n), 10 ** rng.uniform(-3, 1) * rng.random(n)
    tight = rng.uniform(0, 0.5)
    lower[rng.random(n) < tight], upper[rng.random(n) < tight] = 0.0, 0.0
    lower[rng.random(n) < 0.2], upper[rng.random(n) < 0.2] = -np.inf, np.inf
    return H, rng.normal(size=k) * 10 ** rng.uniform(-6, 1), Z, lower, upper


@pytest.mark.parametrize(("n", "k"), [(7, 1), (7, 2), (7, 4), (8, 2), (10, 4), (12, 6), (30, 24)])
def test_the_row_qp_is_as_good_as_a_backends_and_inside_the_rows(n, k, rng):
    backend, unsolved = Backend("daqp"), 0
    for _ in range(few(200)):
        H, c, Z, lower, upper = random_row_qp(n, k, rng)
        z, x, found = row_qp(H, c, Z, lower, upper)
        assert np.abs(Z @ z - x).max() < 1e-12 * max(1, np.abs(z).max())
        assert (x >= lower - 1e-12).all()
        assert (x <= upper + 1e-12).all()
        assert 0.5 * z @ H @ z + c @ z <= 1e-15
        unsolved += not found
        rows, room = np.vstack([Z, -Z]), np.r_[upper, -lower]
        felt = np.isfinite(room) & (rows != 0).any(axis=1)
        free = np.full(k, np.inf)
        # daqp is as exact as its scales: it gets numbers near 1
        size = max(np.abs(c).max(), 1e-9)
        reference = backend.solve(QP(H, c / size, -free, free, rows[felt], room[felt] / size))
        if found and reference.found and reference.primal_residual() < 1e-9:
            best = size**2 * (0.5 * reference.x @ H @ reference.x + c @ reference.x / size)
            assert 0.5 * z @ H @ z + c @ z <= best + 1e-8 * (size**2 + abs(best))
    assert unsolved == 0


def test_a_vertex_where_more_rows_meet_than_there_are_variables_is_left(rng):
    """All rooms empty on one side, so that z = 0 is degenerate; the conditions of the optimum by SciPy's NNLS."""
    for _ in range(few(500)):
        n, k = 9, 3
        Z, c = np.linalg.qr(rng.normal(size=(n, k)))[0], rng.normal(size=k)
        lower, upper = -rng.random(n), rng.random(n)
        for i in range(n):
            (lower if rng.random() < 0.5 else upper)[i] = 0.0
        z, x, found = row_qp(np.eye(k), c, Z, lower, upper)
        assert found
        assert (x >= lower - 1e-15).all()
        assert (x <= upper + 1e-15).all()
        rows = np.vstack([Z[x >= upper - 1e-12], -Z[x <= lower + 1e-12]])
        assert nnls(rows.T, -(z + c))[1] < 1e-9 if len(rows) else np.abs(z + c).max() < 1e-9


def test_rows_that_rounding_takes_for_independent_do_not_overflow_the_active_set():
    """Of a tick at limits: rooms of 1e-11 beside empty ones, and more rows than variables that seemed to be new."""
    H, Z = np.zeros((5, 5)), np.zeros((7, 5))
    H[np.triu_indices(5)] = [
        1896.62339048,
        6021.19102065,
        -0.00130149577054,
        5288.89255372,
        1.79828742027e-14,
        19151.1772583,
        -0.0041391137501,
        16821.1112964,
        1.03702602999e-14,
        2.83940284908,
        -0.00363611671044,
        3.12157283662e-22,
        14780.1716016,
        -1.77925044435e-14,
        2.83940284818,
    ]
    Z[[0, 1, 2, 3, 5]] = [
        [-0.350612802574, 0.392784345409, 0, -0.54902275047, 0],
        [-0.836678630739, -0.308871657054, 0, 0.431731989018, 0],
        [0.384954865017, -0.295182242572, 0, 0.412597316063, 0],
        [-0.0988278938051, 0.685700173726, 0, 0.439319329068, 0],
        [0.138138810049, 0.439319329069, 0, 0.385931977179, 0],
    ]
    Z[4, 2] = Z[6, 4] = 1.0
    c, lower, upper = (
        np.array([-0.760917719076, -0.275817209924, 8.86597531084e-16, 0.38552994433, 1.45578665616e-15]),
        np.array([0, 0, 0, -0.0113754812337, -0.0314159265359, -0.0314159265359, -0.0314159265546]),
        np.array(
            [0.0628318530718, 0.0628318530718, 0.0628318530718, 0.0514563718381, 0, 1.06474466492e-11, 0.0314159265172]
        ),
    )
    z, x, _ = row_qp(np.triu(H) + np.triu(H, 1).T, c, Z, lower, upper)
    assert (x >= lower).all()
    assert (x <= upper).all()
    assert c @ z <= 0.0


def test_an_indefinite_row_qp_is_told_and_stays_inside(rng):
    Z = np.linalg.qr(rng.normal(size=(7, 3)))[0]
    for H in (-np.eye(3), np.full((3, 3), np.nan)):
        assert not row_qp(H, np.ones(3), Z, -np.ones(7), np.ones(7))[2]
