"""The levels of a tick, their true costs and their quadratic models: the compiled form of `maira_qp.problem.costs`.

A level holds tasks, or an objective that is a posture; the first, where it is the only one, both.

The tasks (see `task_rows`) are in the order of their levels. `objectives` (L, 3 + 2 n): weight, 0 where the level has
none, and gain; 1 where the level is damped; the reference and the weights of the posture.
"""

from __future__ import annotations

from maira_qp.kernels.compilation import bare_kernel, inner_kernel
from maira_qp.kernels.null_space import factor, null_vector
from maira_qp.kernels.objective import objective_cost
from maira_qp.kernels.pose_hessian import add_curvature
from maira_qp.kernels.task_rows import (
    ABSENT,
    COEFFICIENTS,
    COUPLING,
    GAIN,
    JOINTS,
    KIND,
    LEVEL,
    PLACEMENTS,
    POSE,
    STILL,
    TASK_DAMPING,
    WEIGHTS,
    pose_bend,
    task_error,
    task_levers,
)
from maira_qp.kernels.tree import forward, path_jacobian, path_to, place

ROW_SPACE = 1e-6
"""As in `maira_qp.solvers.tick`."""

# the columns of `objectives`
WEIGHT, OBJECTIVE_GAIN, DAMPED, REFERENCE = 0, 1, 2, 3


@inner_kernel
def level_costs(tree, parents, tasks, places, objectives, work, q, values):
    """The true cost of each level at q (n,) into values (L,); the kinematics and the errors are left in `work`."""
    poses, tools, targets, e = work.poses, work.tools, work.targets, work.e
    n = len(q)
    forward(tree, parents, q, poses)
    for level in range(len(objectives)):
        weight, values[level] = objectives[level, WEIGHT], 0.0
        if weight != 0.0:
            own = objectives[level, REFERENCE:]
            values[level] = weight * objective_cost(q, own[:n], own[n:])
    for t in range(len(tasks)):
        for f in range(3):
            joint = places[t, JOINTS + f]
            if joint == ABSENT:
                break
            place(poses, joint, tasks[t, PLACEMENTS + 12 * f :], tools[t, f])
        task_error(tasks[t], places[t], tools[t], targets[t], q, e[t])
        values[places[t, LEVEL]] += 0.5 * _squared_error(tasks[t], e[t])


@bare_kernel
def _squared_error(task, e):
    s = 0.0
    for k in range(6):
        s += (task[WEIGHTS + k] * e[k]) ** 2
    return s


@inner_kernel
def level_model(tree, parents, tasks, places, objectives, level, work, q):
    """The model of a level at q (n,), from the kinematics and errors in `work`, after those of the levels above.

    The curvature of its tasks into work.H, of any definiteness, its pull into work.c, its gradient into work.g, and the
    rows of its tasks into work.rows. Returns the squared error of the tasks, and the damping that they ask for.
    """
    H, c, g, rows, ends, e = work.H[level], work.c[level], work.g, work.rows, work.ends, work.e
    levers, pull = work.levers, work.pull
    n, squared, asked, end = len(q), 0.0, 0.0, ends[level - 1] if level > 0 else 0
    weight, own = objectives[level, WEIGHT], objectives[level, REFERENCE:]
    for i in range(n):
        for j in range(n):
            H[i, j] = 0.0
        g[i] = weight * own[n + i] * (q[i] - own[i])
        c[i] = objectives[level, OBJECTIVE_GAIN] * g[i]
    for t in range(len(tasks)):
        if places[t, LEVEL] != level:
            continue
        task, row, kind = tasks[t], end, places[t, KIND]
        if kind == STILL:
            end = _add_still_rows(task, rows, end)
            continue
        if kind == COUPLING:
            end = _add_coupling_row(task, rows, end)
        else:
            tools, path, J = work.tools[t], work.paths[t], work.J[t]
            task_levers(task, places[t], tools, work.targets[t], work.pull, levers)
            end, work.counts[t] = _add_rows(
                tree, parents, work.poses, task, places[t], tools, levers, path, J, rows, end
            )
        for k in range(6):
            if task[WEIGHTS + k] > 0.0:
                r = task[WEIGHTS + k] * e[t, k]
                for i in range(n):
                    slope = r * rows[row, i]
                    g[i] -= slope
                    c[i] -= task[GAIN] * slope
                row += 1
        if kind == POSE:
            for k in range(6):
                pull[k] = -(task[WEIGHTS + k] ** 2) * e[t, k]
            pose_bend(task, places[t], work.tools[t, 0], work.targets[t], True, pull, work.off, work.inverse, work.S)
            _add_on_path(work.J[t], work.paths[t, : work.counts[t]], pull, work.S, work.C, H)
        error = _squared_error(task, e[t])
        squared, asked = squared + error, asked + task[TASK_DAMPING] * error
    ends[level] = end
    return squared, asked


@inner_kernel
def _add_rows(tree, parents, poses, task, place, tools, levers, path, J, rows, end):
    """The rows of W J of a task of frames that count into `rows` (m, n) from number `end` on: where they end.

    The path of its last frame and the Jacobian on it stay in path (n,) and J (n, 6); how long it is is returned too.
    """
    last, count = end, 0
    for k in range(6):
        if task[WEIGHTS + k] > 0.0:
            for i in range(len(tree)):
                rows[last, i] = 0.0
            last += 1
    for f in range(3):
        joint = place[JOINTS + f]
        if joint == ABSENT:
            break
        count, row = path_to(parents, joint, path), end
        path_jacobian(tree, poses, path, tools[f], J[:count])
        for k in range(6):
            if task[WEIGHTS + k] == 0.0:
                continue
            for j in range(6):
                lever = task[WEIGHTS + k] * levers[f, k, j]
                if lever != 0.0:
                    for a in range(count):
                        rows[row, path[a]] += lever * J[a, j]
            row += 1
    return last, count


@bare_kernel
def _add_coupling_row(task, rows, end):
    """The row of a coupling: where it ends."""
    for i in range(rows.shape[1]):
        rows[end, i] = task[WEIGHTS + 3] * task[COEFFICIENTS + i]
    return end + 1


@bare_kernel
def _add_still_rows(task, rows, end):
    """One row for each joint that is to stand still: where they end."""
    for i in range(rows.shape[1]):
        if task[COEFFICIENTS + i] > 0.0:
            for j in range(rows.shape[1]):
                rows[end, j] = 0.0
            rows[end, i] = task[COEFFICIENTS + i]
            end += 1
    return end


@inner_kernel
def add_curvature_above(tasks, places, level, work):
    """How the rows above a level bend, times their multipliers, added to its curvature."""
    pull, multipliers, row = work.pull, work.multipliers, 0
    for t in range(len(tasks)):
        if places[t, LEVEL] >= level:
            break
        if places[t, KIND] == STILL:
            for i in range(len(work.H[level])):
                row += tasks[t, COEFFICIENTS + i] > 0.0
            continue
        for k in range(6):
            weight = tasks[t, WEIGHTS + k]
            pull[k] = weight * multipliers[row] if weight > 0.0 else 0.0
            row += weight > 0.0
        if places[t, KIND] == POSE:
            tool, target = work.tools[t, 0], work.targets[t]
            pose_bend(tasks[t], places[t], tool, target, False, pull, work.off, work.inverse, work.S)
            _add_on_path(work.J[t], work.paths[t, : work.counts[t]], pull, work.S, work.C, work.H[level])


@bare_kernel
def _add_on_path(J, path, pull, S, C, H):
    """What `pose_bend` tells, of a frame with the Jacobian J (n, 6) on its path (k,), added to H (n, n). Work: C."""
    count = len(path)
    for j in range(count):
        x = S[0, 0] * J[j, 3] + S[0, 1] * J[j, 4] + S[0, 2] * J[j, 5]
        y = S[1, 0] * J[j, 3] + S[1, 1] * J[j, 4] + S[1, 2] * J[j, 5]
        z = S[2, 0] * J[j, 3] + S[2, 1] * J[j, 4] + S[2, 2] * J[j, 5]
        for i in range(j + 1):
            C[i, j] = J[i, 3] * x + J[i, 4] * y + J[i, 5] * z
            C[j, i] = C[i, j]
    add_curvature(J[:count], pull, C)
    for a in range(count):
        for b in range(count):
            H[path[a], path[b]] += C[a, b]


@inner_kernel
def finish_hessian(objectives, level, work):
    """The Hessian of a level from its curvature in work.H: that kept to what its tasks feel, and Gauss-Newton's part.

    As `_bent_along_rows` in `maira_qp.solvers.tick`.
    """
    H, rows = work.H[level], work.rows[work.ends[level - 1] if level > 0 else 0 : work.ends[level]]
    n, weight, own = len(H), objectives[level, WEIGHT], objectives[level, REFERENCE:]
    if len(rows) > 0:
        _leave_out_self_motion(H, rows, work.F, work.tau, work.order, work.z, work.y)
    for i in range(n):
        for j in range(i + 1):
            s = H[i, j]
            for k in range(len(rows)):
                s += rows[k, i] * rows[k, j]
            H[i, j], H[j, i] = s, s
        H[i, i] += weight * own[n + i]


@inner_kernel
def _leave_out_self_motion(H, rows, F, tau, order, z, Hz):
    """Take out of H (n, n) what bends along the null space of the rows (m, n). Work: F, tau, order, z and Hz (n,)."""
    n, m = len(H), len(rows)
    for i in range(n):
        for k in range(m):
            F[i, k] = rows[k, i]
    rank = factor(F, n, m, ROW_SPACE, tau, order)
    for a in range(n - rank):
        null_vector(F, n, rank, tau, a, z)
        whole = 0.0
        for i in range(n):
            s = 0.0
            for j in range(n):
                s += H[i, j] * z[j]
            Hz[i] = s
            whole += s * z[i]
        for i in range(n):
            for j in range(n):
                H[i, j] += whole * z[i] * z[j] - z[i] * Hz[j] - Hz[i] * z[j]


@bare_kernel
def level_damping(H, squared, asked, damping, least_damping):
    """The damping mu of a level with the Hessian H (n, n)."""
    largest = 0.0
    for i in range(len(H)):
        for j in range(len(H)):
            largest = max(largest, abs(H[i, j]))
    return damping * min(squared, 1.0) + least_damping * largest + asked
