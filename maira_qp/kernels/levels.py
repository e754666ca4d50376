"""The levels of a tick, their true costs and their quadratic models: the compiled form of `maira_qp.problem.costs`.

A level holds tasks, or an objective that is a posture; the first, where it is the only one, both.

The tasks (see `task_rows`) are in the order of their levels. `objectives` (L, 3 + 2 n): weight, 0 where the level has
none, and gain; 1 where the level is damped; the reference and the weights of the posture.
"""

from __future__ import annotations

from maira_qp.kernels.compilation import bare_kernel, inner_kernel
from maira_qp.kernels.null_space import factor, null_vector
from maira_qp.kernels.objective import objective_cost
from maira_qp.kernels.pose_error import pose_error
from maira_qp.kernels.pose_hessian import add_curvature
from maira_qp.kernels.rotation_vector import bend_of_even_cost, bend_of_logarithm, inverse_right_jacobian
from maira_qp.kernels.task_rows import (
    ABSENT,
    AXES,
    COEFFICIENTS,
    COUPLING,
    GAIN,
    JOINTS,
    KIND,
    LEVEL,
    PLACEMENTS,
    POSE,
    STILL,
    TARGET_AXES,
    TASK_DAMPING,
    WEIGHTS,
    task_error,
    task_levers,
    turns_evenly,
)
from maira_qp.kernels.tree import forward, path_jacobian, path_to, place
from maira_qp.kernels.vectors import turned

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
    n, squared, asked, end = len(q), 0.0, 0.0, ends[level - 1] if level > 0 else 0
    weight, own = objectives[level, WEIGHT], objectives[level, REFERENCE:]
    H[:] = 0.0
    for i in range(n):
        g[i] = weight * own[n + i] * (q[i] - own[i])
        c[i] = objectives[level, OBJECTIVE_GAIN] * g[i]
    for t in range(len(tasks)):
        if places[t, LEVEL] != level:
            continue
        task, row, end = tasks[t], end, add_rows(tree, parents, tasks, places, t, work, end)
        if places[t, KIND] == STILL:
            continue
        for k in range(6):
            if task[WEIGHTS + k] > 0.0:
                r = task[WEIGHTS + k] * e[t, k]
                for i in range(n):
                    g[i] -= r * rows[row, i]
                    c[i] -= task[GAIN] * r * rows[row, i]
                row += 1
        if places[t, KIND] == POSE:
            for k in range(6):
                work.pull[k] = -(task[WEIGHTS + k] ** 2) * e[t, k]
            _add_bend(tasks, places, t, work, True, H)
        error = _squared_error(task, e[t])
        squared, asked = squared + error, asked + task[TASK_DAMPING] * error
    ends[level] = end
    return squared, asked


@inner_kernel
def add_rows(tree, parents, tasks, places, t, work, end):
    """The rows of W J of task t that count into work.rows (m, n) from number `end` on: where they end.

    Of a pose the path of its frame and the Jacobian on it stay in `work`.
    """
    task, kind, rows, levers, path, J = tasks[t], places[t, KIND], work.rows, work.levers, work.paths[t], work.J[t]
    n = len(tree)
    if kind in (STILL, COUPLING):
        return _add_joint_rows(task, kind, n, rows, end)
    task_levers(task, places[t], work.tools[t], work.targets[t], work.pull, levers)
    last = end
    for k in range(6):
        if task[WEIGHTS + k] > 0.0:
            rows[last] = 0.0
            last += 1
    for f in range(3):
        joint = places[t, JOINTS + f]
        if joint == ABSENT:
            break
        count, row = path_to(parents, joint, path), end
        work.counts[t] = count
        path_jacobian(tree, work.poses, path, work.tools[t, f], J[:count])
        for k in range(6):
            if task[WEIGHTS + k] == 0.0:
                continue
            for j in range(6):
                lever = task[WEIGHTS + k] * levers[f, k, j]
                if lever != 0.0:
                    for a in range(count):
                        rows[row, path[a]] += lever * J[a, j]
            row += 1
    return last


@bare_kernel
def _add_joint_rows(task, kind, n, rows, end):
    """One row for a coupling, or one for each joint that is to stand still."""
    if kind == COUPLING:
        for i in range(n):
            rows[end, i] = task[WEIGHTS + 3] * task[COEFFICIENTS + i]
        return end + 1
    for i in range(n):
        if task[COEFFICIENTS + i] > 0.0:
            rows[end] = 0.0
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
            _add_bend(tasks, places, t, work, False, work.H[level])


@inner_kernel
def _add_bend(tasks, places, t, work, of_cost, H):
    """How the rows of task t, a pose, bend, weighted by work.pull (6,), added to H (n, n).

    Rows whose turns count the same bend as the frame's pose does, others as the error. For the pull of a cost it is
    what this bends beside Gauss-Newton's part.
    """
    task, pull, tool, target, e = tasks[t], work.pull, work.tools[t, 0], work.targets[t], work.off
    inverse, S, C = work.inverse, work.S, work.C
    path, count = work.paths[t], work.counts[t]
    J = work.J[t, :count]
    if places[t, AXES] == TARGET_AXES:
        pull[0], pull[1], pull[2] = turned(target, (pull[0], pull[1], pull[2]))
        pull[3], pull[4], pull[5] = turned(target, (pull[3], pull[4], pull[5]))
    C[:] = 0.0
    even = turns_evenly(task)
    if of_cost or not even:
        pose_error(tool, target, e)
        phi, u = (e[3], e[4], e[5]), (pull[3], pull[4], pull[5])
        if even:
            bend_of_even_cost(phi, task[WEIGHTS + 3], S)
        else:
            inverse_right_jacobian(phi, inverse)
            bend_of_logarithm(phi, u, inverse, S)
            for k in range(3):
                pull[3 + k] = inverse[0, k] * u[0] + inverse[1, k] * u[1] + inverse[2, k] * u[2]
        _add_turns(J, S, C)
    add_curvature(J, pull, C)
    for a in range(count):
        for b in range(count):
            H[path[a], path[b]] += C[a, b]


@bare_kernel
def _add_turns(J, S, C):
    """Add `w_i . S w_j` to C (k, k), w the angular parts of J (k, 6)."""
    for j in range(len(J)):
        x = S[0, 0] * J[j, 3] + S[0, 1] * J[j, 4] + S[0, 2] * J[j, 5]
        y = S[1, 0] * J[j, 3] + S[1, 1] * J[j, 4] + S[1, 2] * J[j, 5]
        z = S[2, 0] * J[j, 3] + S[2, 1] * J[j, 4] + S[2, 2] * J[j, 5]
        for i in range(len(J)):
            C[i, j] += J[i, 3] * x + J[i, 4] * y + J[i, 5] * z


@inner_kernel
def finish_hessian(objectives, level, work):
    """The Hessian of a level from its curvature in work.H: that kept to what its tasks feel, and Gauss-Newton's part.

    As `_bent_along_rows` in `maira_qp.solvers.tick`.
    """
    H, rows = work.H[level], work.rows[work.ends[level - 1] if level > 0 else 0 : work.ends[level]]
    n, weight, own = len(H), objectives[level, WEIGHT], objectives[level, REFERENCE:]
    if len(rows) > 0:
        _leave_out_self_motion(H, rows, work)
    for k in range(len(rows)):
        for i in range(n):
            slope = rows[k, i]
            if slope != 0.0:
                for j in range(n):
                    H[i, j] += slope * rows[k, j]
    for i in range(n):
        H[i, i] += weight * own[n + i]


@inner_kernel
def _leave_out_self_motion(H, rows, work):
    """Take out of H (n, n) what bends along the null space of the rows (m, n)."""
    F, tau, order, z, Hz = work.F, work.tau, work.order, work.z, work.y
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
