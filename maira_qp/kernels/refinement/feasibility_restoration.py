"""Bring an arm that has moved along its self-motion back onto the pose.

A joint that stands on a limit stays there; the others make the shortest step of Newton's method, which converges
quadratically. Where that leaves the limits, or does not halve the error, the damped descent with a box QP of
`solvers.reference.levenberg_marquardt` takes over, with all joints.
"""

from __future__ import annotations

from maira_qp.kernels.jit.decorators import device_kernel, kernel
from maira_qp.kernels.kinematics.serial_chain import jacobian
from maira_qp.kernels.layout import Joint, Setting
from maira_qp.kernels.linalg.qr_null_space import factor, shortest_solution
from maira_qp.kernels.refinement.damped_descent import damped_descent
from maira_qp.kernels.search.levenberg_marquardt import pose_cost, quadratic_model
from maira_qp.kernels.spatial.pose_hessian import weigh

RANK_THRESHOLD = 1e-10
"""Pivots below this share of the first count as zero. No pivot is smaller than the smallest singular value, and seldom
several times larger, so that what `problem.qp.hierarchy` takes for a null space is one here too."""

FARTHEST = 0.5
"""A joint that would have to move farther [rad or m] is not near its pose: no step of Newton's method."""


@kernel
def factor_rows(settings, J, fixed, At, tau, order, joints):
    """Factor the weighted rows of the task, W J, of the joints that are not `fixed` (n,): their number and the rank."""
    p, o = settings[Setting.POSITION_WEIGHT], settings[Setting.ORIENTATION_WEIGHT]
    n = 0
    for i in range(len(J)):
        if not fixed[i]:
            joints[n] = i
            At[n, 0], At[n, 1], At[n, 2] = p * J[i, 0], p * J[i, 1], p * J[i, 2]
            At[n, 3], At[n, 4], At[n, 5] = o * J[i, 3], o * J[i, 4], o * J[i, 5]
            n += 1
    return n, factor(At, n, 6, RANK_THRESHOLD, tau, order)


@device_kernel
def _follow_newton(chain, settings, target, cost, enough, most, work, q):
    """Newton's method with the shortest steps of the joints off their limits, while it is well inside its range."""
    axes, origins, tool, e, J = work.axes, work.origins, work.tool, work.e, work.J
    At, tau, order, joints = work.At, work.tau, work.order, work.joints
    weighted, x, fixed, trial = work.weighted, work.x, work.side, work.trial
    n, spent, near = len(q), 0, True
    while near and cost > enough and spent < most:
        spent += 1
        jacobian(chain, axes, origins, tool, J)
        for i in range(n):
            fixed[i] = q[i] <= chain[i, Joint.LOWER] or q[i] >= chain[i, Joint.UPPER]
            trial[i] = q[i]
        count, rank = factor_rows(settings, J, fixed, At, tau, order, joints)
        weigh(settings, e, weighted)
        shortest_solution(At, count, rank, tau, order, weighted, x)
        for a in range(count):
            i = joints[a]
            trial[i] += x[a]
            near = near and abs(x[a]) <= FARTHEST and chain[i, Joint.LOWER] <= trial[i] <= chain[i, Joint.UPPER]
        value = pose_cost(chain, settings, target, trial, axes, origins, tool, e) if near else cost
        near = near and value < 0.25 * cost
        if near:
            cost = value
            for i in range(n):
                q[i] = trial[i]
    return cost, spent


@device_kernel
def _model(chain, settings, problem, enough, cost, work, q):
    """Gauss-Newton's H and c at q (n,), unless the pose costs little enough; the cost, and the largest of |H|."""
    H, lower, upper, largest = work.H, work.lower, work.upper, 0.0
    if cost > enough:
        jacobian(chain, work.axes, work.origins, work.tool, work.J)
        largest = quadratic_model(settings, work.J, work.e, H, work.c, True)
        for i in range(len(q)):
            lower[i], upper[i] = chain[i, Joint.LOWER] - q[i], chain[i, Joint.UPPER] - q[i]
    return cost, largest


@device_kernel
def _value(problem, cost, q):
    """The pose's cost alone."""
    return cost


_descend = damped_descent(_model, _value)


@device_kernel
def restore(chain, settings, target, cost, enough, most, work, q):
    """Lower the pose's cost at q (n,), in place, to `enough`, in at most `most` iterations of either kind.

    `work` holds the kinematics of q before and after. Returns the cost and the iterations spent.
    """
    cost, spent = _follow_newton(chain, settings, target, cost, enough, most, work, q)
    if cost > enough:
        cost, more, _ = _descend(chain, settings, target, (), enough, most, work, q)
        spent += more
    return cost, spent
