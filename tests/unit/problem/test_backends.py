"""Every QP backend through one suite, judged by the KKT conditions and by problems whose answer is known."""

import numpy as np
import pytest

import maira_qp as mq
from maira_qp.errors import BackendError
from maira_qp.problem.qp import backends
from maira_qp.problem.qp.backends import Backend, available
from maira_qp.problem.qp.qp import QP

BACKENDS = ["daqp", "proxqp", "osqp", "piqp", "clarabel"]


@pytest.fixture(params=BACKENDS)
def backend(request) -> Backend:
    return Backend(request.param)


def box_qp(H, c, lower, upper, G=None, h=None) -> QP:
    n = len(c)
    G = np.empty((0, n)) if G is None else np.array(G, dtype=float)
    h = np.empty(0) if h is None else np.array(h, dtype=float)
    return QP(np.array(H, dtype=float), np.array(c, dtype=float), np.array(lower), np.array(upper), G, h)


def random_qp(rng, *, rows: int = 0) -> QP:
    """A QP as an iteration makes it: a Jacobian of rank <= 6 with damping, 0 inside the box, some joints at a limit."""
    n = int(rng.integers(2, 12))
    J = rng.normal(size=(6, n)) * rng.choice([1.0, 1e-3], size=(6, 1), p=[0.8, 0.2])
    e = rng.normal(size=6) * 10 ** rng.uniform(-6, 0)
    H = J.T @ J
    H += max(1e-9 * np.abs(H).max(), 0.1 * float(e @ e)) * np.eye(n)
    lower, upper = -rng.uniform(0, 3, n), rng.uniform(0, 3, n)
    lower[rng.random(n) < 0.2] = 0.0
    upper[rng.random(n) < 0.1] = np.inf
    G = rng.normal(size=(rows, n))
    return QP(H, -J.T @ e, lower, upper, G, rng.uniform(0, 1, rows))


def test_all_backends_of_the_extras_are_installed():
    assert set(BACKENDS) <= set(available())


@pytest.mark.parametrize("rows", [0, 3])
def test_random_problems_satisfy_the_kkt_conditions(backend, rows, rng):
    """100 problems; residuals relative to the gradient's size, complementarity to that of the cost.

    A backend may give up on a hard one (the descent then damps it more), and daqp may not.
    """
    found = 0
    for _ in range(100):
        qp = random_qp(rng, rows=rows)
        solution = backend.solve(qp)
        force, stiffness = np.abs(qp.c).max(), np.abs(qp.H).max()
        if not solution.found:
            continue
        found += 1
        assert (solution.x >= qp.lower).all()
        assert (solution.x <= qp.upper).all()
        assert solution.primal_residual() <= 1e-7 * force / stiffness
        assert solution.dual_residual() <= 1e-5 * force
        assert solution.complementarity() <= 1e-5 * force**2 / stiffness
    assert found == 100 if backend.name == "daqp" else found >= 75


@pytest.mark.parametrize(
    ("qp", "expected"),
    [
        (box_qp(np.eye(2), [-1, -2], [-5, -5], [5, 5]), [1, 2]),
        (box_qp(np.eye(2), [-1, -2], [-5, -5], [0.5, 5]), [0.5, 2]),
        # an active bound moves the other variable: x2 = (2 - x1) / 2 with x1 at its bound
        (box_qp([[2, 1], [1, 2]], [-4, -2], [0, 0], [1, 5]), [1, 0.5]),
        (box_qp(np.eye(2), [-1, -1], [-5, -5], [5, 5], [[1, 1]], [1]), [0.5, 0.5]),
        (box_qp(np.eye(3), [-1, 0, 0], [-np.inf] * 3, [np.inf] * 3), [1, 0, 0]),
        (box_qp(np.eye(2), [0, 0], [-1, -1], [1, 1]), [0, 0]),
        (box_qp(np.eye(2), [0, 0], [0.25, -1], [1, 1]), [0.25, 0]),
        (box_qp(1e-12 * np.eye(2), [-1e-12, -2e-12], [-5, -5], [5, 5]), [1, 2]),
        (box_qp(1e12 * np.eye(2), [-1e12, -2e12], [-5, -5], [5, 5]), [1, 2]),
        (box_qp(np.eye(2), [-1e-9, -2e-9], [-5, -5], [5, 5]), [1e-9, 2e-9]),
        (box_qp(np.eye(2), [-1e-9, -2e-9], [-5, -5], [0, 5]), [0, 2e-9]),
    ],
)
def test_small_problems_have_their_known_answer(backend, qp, expected):
    x = backend.solve(qp).x
    scale = max(np.abs(expected).max(), 1e-9)
    assert np.abs(x - expected).max() <= 1e-6 * scale


def test_residuals_of_a_wrong_answer_are_large(rng):
    """The judge can condemn: an answer moved by 1e-3, or a multiplier of the wrong sign, is seen."""
    from dataclasses import replace

    qp = random_qp(rng, rows=2)
    good = Backend("daqp").solve(qp)
    assert replace(good, x=good.x + 1e-3).dual_residual() > 1e3 * good.dual_residual()
    assert replace(good, z=good.z - 1.0).complementarity() >= 1.0
    assert replace(good, x=np.where(np.isfinite(qp.upper), qp.upper, 0) + 0.5).primal_residual() >= 0.5


@pytest.mark.parametrize(
    "spoil",
    [
        lambda qp: QP(qp.H * np.nan, qp.c, qp.lower, qp.upper, qp.G, qp.h),
        lambda qp: QP(qp.H, qp.c * np.nan, qp.lower, qp.upper, qp.G, qp.h),
        lambda qp: QP(qp.H, qp.c * np.inf, qp.lower, qp.upper, qp.G, qp.h),
        lambda qp: QP(qp.H, qp.c, qp.upper, qp.lower, qp.G, qp.h),
        lambda qp: QP(qp.H, qp.c, qp.lower * np.nan, qp.upper, qp.G, qp.h),
    ],
)
def test_a_qp_with_nan_or_inverted_bounds_is_never_passed_on(backend, spoil):
    """Some backends call NaN solved, one runs for ever: found is False, x finite, residuals infinite."""
    qp = box_qp(np.eye(2), [-1, -2], [-1, -1], [1, 1])
    solution = backend.solve(spoil(qp))
    assert not solution.found
    assert solution.reason
    assert solution.primal_residual() == solution.dual_residual() == solution.complementarity() == np.inf


def test_infeasible_rows_are_told(backend):
    qp = box_qp(np.eye(2), [0, 0], [-1, -1], [1, 1], [[1, 1], [-1, -1]], [-1, -1])
    solution = backend.solve(qp)
    assert not solution.found
    assert np.isfinite(solution.x).all()


def test_an_unknown_backend_is_refused_with_the_names_that_are_valid():
    with pytest.raises(BackendError, match=r"did you mean 'daqp'.*proxqp"):
        Backend("dapq")


def test_settings_that_a_backend_does_not_know_are_refused():
    with pytest.raises(BackendError, match="no_such_setting"):
        Backend("proxqp", {"no_such_setting": 1})


def test_a_known_backend_that_is_not_installed_says_what_installs_it(monkeypatch, maira):
    monkeypatch.setattr(backends, "available", lambda: ("daqp",))
    for make in (mq.Backend, lambda name: mq.Solver(maira, backend=name)):
        with pytest.raises(BackendError, match=r"'piqp' is not installed: pip install 'maira-qp\[qp\]'"):
            make("piqp")
        with pytest.raises(BackendError, match=r"no QP backend 'pikp' here; .*daqp"):
            make("pikp")
