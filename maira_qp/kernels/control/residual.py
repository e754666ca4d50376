"""What a tick leaves of each level's error, and multipliers of the rows above: see `solvers.reference.step_models`."""

from __future__ import annotations

import math

from maira_qp.kernels.control.hierarchical_qp import ROW_THRESHOLD, add_rows
from maira_qp.kernels.jit.decorators import device_kernel
from maira_qp.kernels.layout import Joint, Level
from maira_qp.kernels.linalg.ldl import factor_ldl, solve_ldl
from maira_qp.kernels.linalg.qr_null_space import NONE, null_basis, others, reduce
from maira_qp.kernels.linalg.symmetric_eigen import diagonalise

# as in `solvers.reference.step_models`
SINGULAR, FILTER, ABOVE, PASSES, NEAR, BENDS, NOTHING, UNKNOWN = 1e-2, 4, 1e-5, 4, 0.1, 1e-6, 1e-6, 1e-8

TINY = 1e-30


@device_kernel
def find_residual(tree, objectives, level, work, q, dt):
    """Split the error of a level into what its step takes away and what it leaves, `work.left`: whether that bends.

    From the gradient `work.g`. The multipliers of the rows above that balance the gradient into work.balances, those
    that balance what is left of it into work.weights.
    """
    g, held, left, errors = work.g, work.held, work.left, work.errors
    first, m = work.ends[level - 1] if level > 0 else 0, work.ends[level]
    above, x, K, A = work.balances[level], work.weights, work.rows[:first], work.rows[first:m]
    for i in range(len(q)):
        held[i] = not tree[i, Joint.LOWER] < tree[i, Joint.UPPER]
    if first == 0:
        _hold(tree, K, above, g, q, dt, held)
    factor_above(K, held, work.gram, work.factor)
    for _ in range(PASSES if first > 0 else 0):
        _balance(K, g, held, work.factor, above)
        if not _hold(tree, K, above, g, q, dt, held):
            break
        factor_above(K, held, work.gram, work.factor)
    _balance(K, g, held, work.factor, above)
    work.gradients[level], work.left_norms[level] = 0.0, 0.0
    if m == first:
        for k in range(first):
            x[k] = above[k]
        return False
    nu, whole = _factor_own(A, level, work), 0.0
    for k in range(first, m):
        left[k] = errors[k]
        whole += errors[k] * errors[k]
    if objectives[level, Level.WEIGHT] != 0.0:
        _weighted_residual(objectives[level], A, held, nu, work)
    else:
        for _ in range(FILTER):
            solve_ldl(work.own_factor, m - first, left[first:m])
            for k in range(first, m):
                left[k] *= nu
    rest, y = 0.0, work.y
    for k in range(first, m):
        rest += left[k] * left[k]
    for i in range(len(q)):
        s = g[i]
        for k in range(first, m):
            s += work.rows[k, i] * (errors[k] - left[k])
        y[i] = s
    _balance(K, y, held, work.factor, x)
    work.left_norms[level] = math.sqrt(rest)
    return rest > max(BENDS * BENDS * whole, NOTHING * NOTHING)


@device_kernel
def factor_above(K, held, gram, factor):
    """Factor `K K^T + eps I`, K (m, n) the rows above in the joints that are not held."""
    m, size = len(K), 0.0
    for k in range(m):
        for j in range(k + 1):
            s = 0.0
            for i in range(len(held)):
                if held[i] == 0:
                    s += K[k, i] * K[j, i]
            gram[k, j], gram[j, k] = s, s
        size += gram[k, k]
    for k in range(m):
        gram[k, k] += ABOVE * ABOVE * size + TINY
    factor_ldl(gram, m, 0.0, factor)


@device_kernel
def _factor_own(A, level, work):
    """Factor `A Z Z^T A^T + nu I`, A (m, n) the rows of a level and Z what those above leave to it, not held: nu.

    The norm of its gradient there is left in work.gradients.
    """
    gram, held, joints, Z, b, g, AZ = work.gram, work.held, work.joints, work.Z, work.b, work.g, work.AZ
    count, rank, size, square = others(held, joints), NONE, 0.0, 0.0
    for above in range(level):
        rank = add_rows(work, above, joints[:count], rank, ROW_THRESHOLD)
    if rank > 0:
        null_basis(work.F, work.tau, joints, count, rank, g, work.y, Z, b)
    for r in range(len(A)):
        for a in range(count):
            size += A[r, joints[a]] ** 2
        for p in range(count - rank):
            s = 0.0
            if rank > 0:
                for i in range(len(held)):
                    s += A[r, i] * Z[i, p]
            else:
                s = A[r, joints[p]]
            AZ[r, p] = s
        for t in range(r + 1):
            s = 0.0
            for p in range(count - rank):
                s += AZ[r, p] * AZ[t, p]
            gram[r, t], gram[t, r] = s, s
    for p in range(count - rank):
        square += (b[p] if rank > 0 else g[joints[p]]) ** 2
    nu = max(SINGULAR * SINGULAR * size, TINY)
    for r in range(len(A)):
        gram[r, r] += nu
    factor_ldl(gram, len(A), 0.0, work.own_factor)
    work.gradients[level] = math.sqrt(square)
    return nu


@device_kernel
def _balance(K, g, held, factor, multipliers):
    """The multipliers (m,) of the rows K (m, n), factored, that balance g (n,) on the joints that are not held."""
    for k in range(len(K)):
        s = 0.0
        for i in range(len(g)):
            s -= 0.0 if held[i] else K[k, i] * g[i]
        multipliers[k] = s
    solve_ldl(factor, len(K), multipliers)


@device_kernel
def _hold(tree, K, multipliers, g, q, dt, held):
    """Hold the joints that are pulled into a limit that is near, and no others: whether any changed."""
    changed = False
    for i in range(len(q)):
        pull = -g[i]
        for k in range(len(K)):
            pull -= K[k, i] * multipliers[k]
        lower, upper = tree[i, Joint.LOWER], tree[i, Joint.UPPER]
        reach = min(tree[i, Joint.VELOCITY] * dt, NEAR)
        hold = not lower < upper or (pull < 0.0 and lower - q[i] >= -reach) or (pull > 0.0 and upper - q[i] <= reach)
        changed = changed or hold != (held[i] != 0)
        held[i] = hold
    return changed


@device_kernel
def _weighted_residual(objective, rows, held, nu, work):
    """The same of a first level with a posture beside its tasks."""
    n, errors, left, M, F, x = len(held), work.errors, work.left, work.M, work.A, work.y
    H, g = work.H[0], work.g
    for i in range(n):
        x[i] = 0.0 if held[i] else -g[i]
        for j in range(n):
            s = H[i, j]
            for k in range(len(rows)):
                s += rows[k, i] * rows[k, j]
            M[i, j] = 0.0 if held[i] or held[j] else s
        M[i, i] += 1.0 if held[i] else nu * SINGULAR**3
    if not factor_ldl(M, n, 0.0, F):
        return
    solve_ldl(F, n, x)
    for k in range(len(rows)):
        s = errors[k]
        for i in range(n):
            s -= rows[k, i] * x[i]
        left[k] = s


@device_kernel
def add_bent_directions(tree, objectives, level, work):
    """Add to the rows of a level the directions in which it bends though its rows do not feel them.

    Returns whether it added any.
    """
    rows, ends, F, Z, M, A, V, joints = work.rows, work.ends, work.F, work.Z, work.M, work.A, work.V, work.joints
    n, held, rank = len(tree), work.held, NONE
    for i in range(n):
        held[i] = not tree[i, Joint.LOWER] < tree[i, Joint.UPPER]
    count = others(held, joints)
    for k in range(level + 1):
        rank = add_rows(work, k, joints[:count], rank, ABOVE)
    k = count - rank
    if k == 0:
        return False
    flat = work.flat[level]
    null_basis(F, work.tau, joints, count, rank, work.g, work.y, Z, work.b)
    reduce(work.curvature, k, Z, work.y, M)  # Gauss-Newton's part, zero here, would leave its rounding
    if k == 1:
        A[0, 0], V[0, 0] = M[0, 0], 1.0
    else:
        diagonalise(M, k, A, V)
    added = False
    for p in range(k):
        if abs(A[p, p]) <= flat:
            continue
        for i in range(n):
            s = 0.0
            for b in range(k):
                s += Z[i, b] * V[p, b]
            rows[ends[level], i] = s if abs(s) > UNKNOWN else 0.0
        work.errors[ends[level]] = 0.0
        ends[level] += 1
        added = True
    return added
