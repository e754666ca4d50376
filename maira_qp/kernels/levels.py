"""The levels of a tick, their true costs and their quadratic models: the compiled form of `maira_qp.problem.costs`.

A level holds tasks of frames, or an objective that is a posture; the first, where it is the only one, both.

`tasks` (T, 28) are in the order of their levels: the weights of position and orientation, gain and damping, the frame's
placement behind its joint (12,) and the target (12,) where it has one of its own. `places` (T, 3) of int64: that joint,
the level, and which target of the call it takes, or `OWN`. `objectives` (L, 3 + 2 n): weight, 0 where the level has
none, and gain; 1 where the level is damped; the reference and the weights of the posture.
"""

from __future__ import annotations

from maira_qp.kernels.compilation import bare_kernel, inner_kernel
from maira_qp.kernels.descent import ORIENTATION_WEIGHT, POSITION_WEIGHT, squares
from maira_qp.kernels.null_space import factor, null_vector
from maira_qp.kernels.objective import objective_cost
from maira_qp.kernels.pose_error import pose_error
from maira_qp.kernels.pose_hessian import add_curvature, newton_model
from maira_qp.kernels.tree import forward, path_jacobian, path_to, place

# the columns of `tasks`, the first two as of the `settings` of a descent, and of `places`
GAIN, TASK_DAMPING, PLACEMENT, TARGET = 2, 3, 4, 16
TASK = 28
JOINT, LEVEL, SOURCE = 0, 1, 2
OWN = -1

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
        place(poses, places[t, JOINT], tasks[t, PLACEMENT:], tools[t])
        pose_error(tools[t], targets[t], e[t])
        values[places[t, LEVEL]] += 0.5 * _squared_error(tasks[t], e[t])


@bare_kernel
def _squared_error(task, e):
    position, orientation = squares(e)
    return task[POSITION_WEIGHT] ** 2 * position + task[ORIENTATION_WEIGHT] ** 2 * orientation


@inner_kernel
def level_model(tree, parents, tasks, places, objectives, level, work, q):
    """The model of a level at q (n,), from the kinematics and errors in `work`, after those of the levels above.

    Its Hessian, of any definiteness, into work.H, its pull into work.c, its gradient into work.g, and the rows of its
    tasks into work.rows. Returns the squared error of the tasks, and the damping that they ask for.
    """
    H, c, g, rows, ends, e = work.H[level], work.c[level], work.g, work.rows, work.ends, work.e
    C, slope, weighted = work.C, work.y, work.weighted
    n, squared, asked, end = len(q), 0.0, 0.0, ends[level - 1] if level > 0 else 0
    weight, own = objectives[level, WEIGHT], objectives[level, REFERENCE:]
    for i in range(n):
        for j in range(n):
            H[i, j] = 0.0
        H[i, i] = weight * own[n + i]
        g[i] = weight * own[n + i] * (q[i] - own[i])
        c[i] = objectives[level, OBJECTIVE_GAIN] * g[i]
    for t in range(len(tasks)):
        if places[t, LEVEL] != level:
            continue
        path, count = work.paths[t], path_to(parents, places[t, JOINT], work.paths[t])
        J, work.counts[t] = work.J[t, :count], count
        path_jacobian(tree, work.poses, path, work.tools[t], J)
        newton_model(tasks[t], J, e[t], weighted, C, slope[:count])
        for a in range(count):
            g[path[a]] += slope[a]
            c[path[a]] += tasks[t, GAIN] * slope[a]
        _add_on_path(path, count, C, H)
        end = _add_rows(tasks[t], J, path, rows, end)
        error = _squared_error(tasks[t], e[t])
        squared, asked = squared + error, asked + tasks[t, TASK_DAMPING] * error
    ends[level] = end
    return squared, asked


@bare_kernel
def _add_on_path(path, count, C, H):
    """Add C (count, count), of the joints on a path, to H (n, n)."""
    for a in range(count):
        for b in range(count):
            H[path[a], path[b]] += C[a, b]


@bare_kernel
def _add_rows(task, J, path, rows, end):
    """The rows of W J that count into `rows` (m, n) from number `end` on: where they end."""
    for k in range(6):
        weight = task[POSITION_WEIGHT] if k < 3 else task[ORIENTATION_WEIGHT]
        if weight > 0.0:
            row = rows[end]
            for i in range(len(row)):
                row[i] = 0.0
            for a in range(len(J)):
                row[path[a]] = weight * J[a, k]
            end += 1
    return end


@inner_kernel
def add_curvature_above(tasks, places, level, work):
    """How the rows above a level bend, times their multipliers, added to its Hessian."""
    C, weighted, multipliers, row = work.C, work.weighted, work.multipliers, 0
    for t in range(len(tasks)):
        if places[t, LEVEL] >= level:
            break
        for k in range(6):
            weight = tasks[t, POSITION_WEIGHT] if k < 3 else tasks[t, ORIENTATION_WEIGHT]
            weighted[k] = weight * multipliers[row] if weight > 0.0 else 0.0
            row += weight > 0.0
        count = work.counts[t]
        for a in range(count):
            for b in range(count):
                C[a, b] = 0.0
        add_curvature(work.J[t, :count], weighted, C)
        _add_on_path(work.paths[t], count, C, work.H[level])


@inner_kernel
def bend_along_rows(objectives, level, work):
    """The curvature in a level's Hessian kept to what its tasks feel, as in `maira_qp.solvers.tick`."""
    H, rows, C, F, tau, order, z, Sz = work.H[level], work.rows, work.C, work.F, work.tau, work.order, work.z, work.y
    n, start, end = len(H), work.ends[level - 1] if level > 0 else 0, work.ends[level]
    if start == end:
        return
    weight, own = objectives[level, WEIGHT], objectives[level, REFERENCE:]
    for i in range(n):
        for j in range(n):
            s = weight * own[n + i] if i == j else 0.0
            for k in range(start, end):
                s += rows[k, i] * rows[k, j]
            C[i, j] = s
            H[i, j] -= s
        for k in range(start, end):
            F[i, k - start] = rows[k, i]
    rank = factor(F, n, end - start, ROW_SPACE, tau, order)
    for a in range(n - rank):
        null_vector(F, n, rank, tau, a, z)
        whole = 0.0
        for i in range(n):
            s = 0.0
            for j in range(n):
                s += H[i, j] * z[j]
            Sz[i] = s
            whole += s * z[i]
        for i in range(n):
            for j in range(n):
                H[i, j] += whole * z[i] * z[j] - z[i] * Sz[j] - Sz[i] * z[j]
    for i in range(n):
        for j in range(n):
            H[i, j] += C[i, j]


@bare_kernel
def level_damping(H, squared, asked, damping, least_damping):
    """The damping mu of a level with the Hessian H (n, n)."""
    largest = 0.0
    for i in range(len(H)):
        for j in range(len(H)):
            largest = max(largest, abs(H[i, j]))
    return damping * min(squared, 1.0) + least_damping * largest + asked
