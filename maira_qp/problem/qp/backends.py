"""Who solves a QP: the backends of qpsolvers, each with settings that make it accurate, none trusted.

Before a backend sees a QP it is made one of size 1 (`x = s y`, H and c divided by their largest entries): with
tolerances that are absolute, as most are, a small QP would otherwise be "solved" by x = 0. After it, the status is read
and the box is enforced by clipping. The same QP gives the same answer to the bit, but for proxqp, whose last digits
depend on where in memory the QP lies.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from maira_qp.errors import BackendError, listed, shown
from maira_qp.problem.qp.qp import QP, QPSolution

if TYPE_CHECKING:
    import qpsolvers

ACCURATE: Mapping[str, Mapping[str, Any]] = MappingProxyType(
    {
        "daqp": {"primal_tol": 1e-11, "dual_tol": 1e-11},
        "proxqp": {"eps_abs": 1e-10, "eps_rel": 0.0, "max_iter": 1000},
        "piqp": {"eps_abs": 1e-9, "eps_rel": 0.0},
        "osqp": {"eps_abs": 1e-8, "eps_rel": 0.0, "max_iter": 20_000, "eps_prim_inf": 1e-12, "eps_dual_inf": 1e-12},
        "clarabel": {"tol_feas": 1e-9, "tol_gap_abs": 1e-9, "tol_gap_rel": 1e-9},
    }
)
"""Settings of each backend for residuals of about 1e-8 or below on a QP of size 1."""

NONE: Mapping[str, Any] = MappingProxyType({})
DEGENERATE: Mapping[str, Mapping[str, Any]] = MappingProxyType({"daqp": {"eps_prox": 1e-4}})
"""Settings that a backend is tried with again where it fails: proximal-point steps, where limits meet in a corner."""

FAR = 1e8
"""A box bound beyond this, on a QP of size 1, is left out at first, and put in only if the solution breaks it: some
backends return zero where bounds are so large."""

INFINITE = 1e20
"""A row's bound beyond this, on a QP of size 1, is none."""


INSTALLED_BY: Mapping[str, str] = MappingProxyType(
    {
        **dict.fromkeys(("piqp", "clarabel"), "pip install 'maira-qp[qp]'"),
        **{name: f"pip install {name}" for name in ("daqp", "osqp")},
        "proxqp": "pip install proxsuite",
        **{
            name: f"pip install 'qpsolvers[{name}]'"
            for name in ("cvxopt", "ecos", "gurobi", "highs", "mosek", "qpax", "quadprog", "scs", "sip")
        },
    }
)
"""What installs a backend that qpsolvers knows."""


def available() -> tuple[str, ...]:
    """Names of the backends installed here."""
    import qpsolvers  # heavy, here and below: it loads every backend that is installed

    return tuple(qpsolvers.available_solvers)


@dataclass(frozen=True)
class Backend:
    """A QP backend by its name, with its settings.

    Raises `BackendError` if it is not installed or does not understand its settings.
    """

    name: str = "daqp"
    settings: Mapping[str, Any] = field(default_factory=dict)
    """Passed on to the backend in place of the accurate settings; empty: those."""

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or self.name not in available():
            command = INSTALLED_BY.get(self.name) if isinstance(self.name, str) else None
            if command is not None:
                raise BackendError(f"the QP backend {self.name!r} is not installed: {command}; {listed(available())}")
            raise BackendError(f"no QP backend {shown(self.name)} here; {listed(available(), self.name)}")
        if not isinstance(self.settings, (Mapping, type(None))):
            raise BackendError(f"settings of a Backend must be a mapping {{name: value}}, got {shown(self.settings)}")
        object.__setattr__(self, "settings", dict(self.settings or ACCURATE.get(self.name, {})))
        trial = self.solve(QP(np.eye(2), np.ones(2), -np.ones(2), np.ones(2), np.empty((0, 2)), np.empty(0)))
        if not trial.found:
            raise BackendError(
                f"QP backend {self.name!r} with settings {shown(self.settings)} fails: {trial.reason:.300}"
            )

    def solve(self, qp: QP) -> QPSolution:
        """The solution of the QP `qp`; a failure of any kind is a solution that says `found=False`."""
        if not qp.is_well_posed():
            return _nothing(qp, "the QP holds NaN or an empty interval")
        if not qp.c.any() and (qp.lower <= 0).all() and (qp.upper >= 0).all() and (qp.h >= 0).all():
            return QPSolution(qp, True, np.zeros_like(qp.c), np.zeros_like(qp.h), np.zeros_like(qp.c))
        unit, step, force = _unit_size(qp)
        near = _without_far_bounds(unit)
        try:
            answer = self._answer(near)
            if near is not unit and answer.x is not None and np.abs(answer.x).max() > FAR:
                answer = self._answer(unit)
            if not answer.found and self.name in DEGENERATE:
                answer = self._answer(unit, DEGENERATE[self.name])
        except Exception as reason:  # whatever a backend raises, its QP was not solved
            return _nothing(qp, f"{self.name}: {reason}")
        if not answer.found or answer.x is None or not np.isfinite(answer.x).all():
            return _nothing(qp, f"{self.name} did not converge")
        z_box = force * _or_zeros(answer.z_box, len(qp.c))
        z_box[(z_box > 0) & np.isinf(qp.upper) | (z_box < 0) & np.isinf(qp.lower)] = 0.0
        return QPSolution(
            qp,
            found=True,
            x=np.clip(step * answer.x, qp.lower, qp.upper),
            z=force * _or_zeros(answer.z, len(qp.h)),
            z_box=z_box,
        )

    def _answer(self, qp: QP, settings: Mapping[str, Any] = NONE) -> qpsolvers.Solution:
        import qpsolvers

        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # backends warn of what the status says
            return qpsolvers.solve_problem(self._problem(qp), self.name, **{**self.settings, **settings})

    def _problem(self, qp: QP) -> qpsolvers.Problem:
        import qpsolvers

        H, G, h = qp.H, (qp.G if len(qp.h) else None), (qp.h if len(qp.h) else None)
        if self.name not in qpsolvers.dense_solvers:
            import scipy.sparse

            H, G = scipy.sparse.csc_matrix(H), (None if G is None else scipy.sparse.csc_matrix(G))
        bounded = bool(np.isfinite(qp.lower).any() or np.isfinite(qp.upper).any())
        return qpsolvers.Problem(H, qp.c, G, h, None, None, *((qp.lower, qp.upper) if bounded else ()))


def _unit_size(qp: QP) -> tuple[QP, float, float]:
    """The QP in `y = x / step` with largest entries of 1 in H and c; the step; the force that scales multipliers."""
    hessian = np.abs(qp.H).max(initial=0) or 1.0
    force = np.abs(qp.c).max(initial=0) or hessian
    step = force / hessian
    if not (0 < step < np.inf):
        hessian = force = step = 1.0
    with np.errstate(over="ignore"):
        lower, upper, h = qp.lower / step, qp.upper / step, qp.h / step
    return QP(qp.H / hessian, qp.c / force, lower, upper, qp.G, np.minimum(h, INFINITE)), step, force


def _without_far_bounds(unit: QP) -> QP:
    """The QP without the bounds beyond `FAR`; the same QP if it has none."""
    low, high = unit.lower < -FAR, unit.upper > FAR
    if not (low.any() or high.any()):
        return unit
    return replace(unit, lower=np.where(low, -np.inf, unit.lower), upper=np.where(high, np.inf, unit.upper))


def _or_zeros(multipliers: np.ndarray | None, size: int) -> np.ndarray:
    return np.zeros(size) if multipliers is None or len(multipliers) != size else np.asarray(multipliers)


def _nothing(qp: QP, reason: str) -> QPSolution:
    x = np.clip(np.zeros(len(qp.c)), qp.lower, np.maximum(qp.lower, qp.upper))
    return QPSolution(qp, False, x, np.zeros(len(qp.h)), np.zeros(len(qp.c)), reason)
