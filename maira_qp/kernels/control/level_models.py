"""The levels of a tick, their true costs and their quadratic models: the compiled form of `problem.qp.costs`.

A level holds tasks, or an objective that is a posture; the first, where it is the only one, both.

The tasks (see `task_rows`) are in the order of their levels. `objectives` (L, 2 + 2 n): weight, 0 where the level has
none, and gain; the reference and the weights of the posture.
"""

from __future__ import annotations

import math

from maira_qp.kernels.control.task_jacobians import (
    across_axis,
    in_base,
    measure_turn,
    pose_bend,
    task_error,
    task_levers,
)
from maira_qp.kernels.jit.decorators import device_kernel
from maira_qp.kernels.kinematics.kinematic_tree import forward, path_jacobian, path_to, place
from maira_qp.kernels.layout import Joint, Kind, Level, Place, Step, TaskRow
from maira_qp.kernels.refinement.posture_objective import objective_cost
from maira_qp.kernels.search.levenberg_marquardt import squares
from maira_qp.kernels.spatial.pose_hessian import add_curvature as add_pose_curvature

NUDGE, NOISE = 1e-5, 1e-9
"""As in `problem.tasks.task`."""

SADDLE, FLAT, STATIONARY, STEEP, FRICTION, FAINT, STANDING = 1e-3, 1e-5, 0.1, 1e-5, 0.7, 1e-5, 1e-8
"""As in `solvers.reference.step_models`."""

HESSIAN_THRESHOLD = 1e-6
"""As in `problem.qp.costs`."""


@device_kernel
def level_costs(tree, parents, tasks, places, objectives, work, q, values):
    """The true cost of each level at q (n,) into values (L,); the kinematics and the errors are left in `work`."""
    poses, tools, targets, e = work.poses, work.tools, work.targets, work.e
    n = len(q)
    forward(tree, parents, q, poses)
    for level in range(len(objectives)):
        weight, values[level] = objectives[level, Level.WEIGHT], 0.0
        if level == 0:
            weight *= work.fade[0]
        if weight != 0.0:
            own = objectives[level, Level.REFERENCE :]
            values[level] = weight * objective_cost(q, own[:n], own[n:])
    for t in range(len(tasks)):
        for f in range(3):
            joint = places[t, Place.JOINTS + f]
            if joint == Place.ABSENT:
                break
            place(poses, joint, tasks[t, TaskRow.PLACEMENTS + 12 * f :], tools[t, f])
        task_error(tasks[t], places[t], tools[t], targets[t], q, e[t])
        values[places[t, Place.LEVEL]] += 0.5 * _squared_error(tasks[t], e[t])


@device_kernel
def _squared_error(task, e):
    s = 0.0
    for k in range(6):
        s += (task[TaskRow.WEIGHTS + k] * e[k]) ** 2
    return s


@device_kernel
def level_model(tree, parents, tasks, places, objectives, level, work, q):
    """The rows of a level's tasks at q (n,), from the kinematics and errors in `work`, after those of the levels above.

    Its pull into work.c, its gradient into work.g, the Hessian of its objective into work.H, the rows of its tasks into
    work.rows and their errors into work.errors. Returns the damping that they ask for.
    """
    H, c, g, rows, ends, e = work.H[level], work.c[level], work.g, work.rows, work.ends, work.e
    levers, errors = work.levers, work.errors
    n, asked, end = len(q), 0.0, ends[level - 1] if level > 0 else 0
    weight, own = objectives[level, Level.WEIGHT], objectives[level, Level.REFERENCE :]
    for i in range(n):
        for j in range(n):
            H[i, j] = 0.0
        H[i, i] = weight * own[n + i]
        g[i] = weight * own[n + i] * (q[i] - own[i])
        c[i] = objectives[level, Level.GAIN] * g[i]
    for t in range(len(tasks)):
        if places[t, Place.LEVEL] != level:
            continue
        task, row, kind = tasks[t], end, places[t, Place.KIND]
        if kind == Kind.STILL:
            end = _add_still_rows(task, rows, end)
            for k in range(row, end):
                errors[k] = 0.0
            continue
        if kind == Kind.COUPLING:
            end = _add_coupling_row(task, rows, end)
        else:
            tools, path, J = work.tools[t], work.paths[t], work.J[t]
            task_levers(task, places[t], tools, work.targets[t], work.pull, levers)
            end, work.counts[t] = _add_rows(
                tree, parents, work.poses, task, places[t], tools, levers, path, J, rows, end
            )
        for k in range(6):
            if task[TaskRow.WEIGHTS + k] > 0.0:
                r = task[TaskRow.WEIGHTS + k] * e[t, k]
                errors[row] = r
                for i in range(n):
                    slope = r * rows[row, i]
                    g[i] -= slope
                    c[i] -= task[TaskRow.GAIN] * slope
                row += 1
        asked += task[TaskRow.DAMPING] * _squared_error(task, e[t])
    ends[level] = end
    return asked


@device_kernel
def fade_posture(objectives, fading, work, q):
    """Fade the posture of the first level in its model, as `problem.redundancy.Weighted.faded` explains."""
    H, c, g, own, weight = work.H[0], work.c[0], work.g, objectives[0, Level.REFERENCE :], objectives[0, Level.WEIGHT]
    n, slope, pull = len(q), 0.0, 0.0
    for i in range(n):
        part = weight * own[n + i] * (q[i] - own[i])
        g[i] -= part
        c[i] -= objectives[0, Level.GAIN] * part
        slope += g[i] * g[i]
        pull += part * part
    fade = slope / (slope + max(fading * fading, pull))
    for i in range(n):
        part = fade * weight * own[n + i] * (q[i] - own[i])
        g[i] += part
        c[i] += objectives[0, Level.GAIN] * part
        H[i, i] = fade * weight * own[n + i]
    work.values[0] -= (1.0 - fade) * weight * objective_cost(q, own[:n], own[n:])
    work.fade[0] = fade


@device_kernel
def note_where(work):
    """Keep where the frames of the tasks are, and the errors, for `row_changes`."""
    for t in range(len(work.e)):
        for k in range(6):
            work.e_there[t, k] = work.e[t, k]
        for f in range(3):
            for k in range(12):
                work.tools_there[t, f, k] = work.tools[t, f, k]


@device_kernel
def note_start(work):
    """Keep where the frames of the tasks are at the beginning of the tick, of which the rows tell."""
    for t in range(len(work.e)):
        for k in range(12):
            work.tools_here[t, k] = work.tools[t, 0, k]


@device_kernel
def row_changes(tasks, places, level, work, changes):
    """What a motion changed of the errors of the rows of all levels above one, as these tell it; of others nothing.

    From where `note_where` was called to where the costs were computed last.
    """
    change, row = work.off, 0
    for t in range(len(tasks)):
        if places[t, Place.LEVEL] >= level:
            break
        row = max(row, work.ends[places[t, Place.LEVEL] - 1] if places[t, Place.LEVEL] > 0 else 0)
        if places[t, Place.KIND] == Kind.STILL:
            for i in range(tasks.shape[1] - TaskRow.COEFFICIENTS):
                row += tasks[t, TaskRow.COEFFICIENTS + i] > 0.0
            continue
        for k in range(6):
            change[k] = work.e[t, k] - work.e_there[t, k]
        measure_turn(
            tasks[t], places[t], work.tools_here[t], work.tools_there[t], work.tools[t], work.targets[t], change
        )
        for k in range(6):
            if tasks[t, TaskRow.WEIGHTS + k] > 0.0:
                changes[row] = tasks[t, TaskRow.WEIGHTS + k] * change[k]
                row += 1


@device_kernel
def _add_rows(tree, parents, poses, task, place, tools, levers, path, J, rows, end):
    """The rows of W J of a task of frames that count into `rows` (m, n) from number `end` on: where they end.

    The path of its last frame and the Jacobian on it stay in path (n,) and J (n, 6); how long it is is returned too.
    """
    last, count = end, 0
    for k in range(6):
        if task[TaskRow.WEIGHTS + k] > 0.0:
            for i in range(len(tree)):
                rows[last, i] = 0.0
            last += 1
    for f in range(3):
        joint = place[Place.JOINTS + f]
        if joint == Place.ABSENT:
            break
        count, row = path_to(parents, joint, path), end
        path_jacobian(tree, poses, path, tools[f], J[:count])
        for k in range(6):
            if task[TaskRow.WEIGHTS + k] == 0.0:
                continue
            for j in range(6):
                lever = task[TaskRow.WEIGHTS + k] * levers[f, k, j]
                if lever != 0.0:
                    for a in range(count):
                        rows[row, path[a]] += lever * J[a, j]
            row += 1
    return last, count


@device_kernel
def _add_coupling_row(task, rows, end):
    """The row of a coupling: where it ends."""
    for i in range(rows.shape[1]):
        rows[end, i] = task[TaskRow.WEIGHTS + 3] * task[TaskRow.COEFFICIENTS + i]
    return end + 1


@device_kernel
def _add_still_rows(task, rows, end):
    """One row for each joint that is to stand still: where they end."""
    for i in range(rows.shape[1]):
        if task[TaskRow.COEFFICIENTS + i] > 0.0:
            for j in range(rows.shape[1]):
                rows[end, j] = 0.0
            rows[end, i] = task[TaskRow.COEFFICIENTS + i]
            end += 1
    return end


@device_kernel
def add_curvature(tree, parents, tasks, places, level, bends, work, q):
    """Add to the Hessian of a level how the rows above bend, times work.weights, and, if it `bends`, its own tasks."""
    pull, row = work.pull, 0
    for t in range(len(tasks)):
        kind, own = places[t, Place.KIND], places[t, Place.LEVEL] == level
        if places[t, Place.LEVEL] > level or (own and not bends):
            break
        row = max(row, work.ends[places[t, Place.LEVEL] - 1] if places[t, Place.LEVEL] > 0 else 0)
        first, size, whole = row, 0.0, 0.0
        if kind == Kind.STILL:
            for i in range(len(q)):
                row += tasks[t, TaskRow.COEFFICIENTS + i] > 0.0
            continue
        for k in range(6):
            weight = tasks[t, TaskRow.WEIGHTS + k]
            pull[k] = 0.0
            if weight > 0.0:
                pull[k] = -weight * work.left[row] if own else weight * work.weights[row]
                size += pull[k] ** 2 / weight**2
                whole += work.errors[row] ** 2
                row += 1
        if kind == Kind.COUPLING or size == 0.0:
            continue
        if kind == Kind.POSE:
            tool, target = work.tools[t, 0], work.targets[t]
            pose_bend(tasks[t], places[t], tool, target, own, pull, work.off, work.inverse, work.S)
            _add_on_path(work.J[t], work.paths[t, : work.counts[t]], pull, work.S, work.C, work.H[level])
        elif not own or whole > 0.0:
            share = math.sqrt(size / whole) if own else 1.0
            _add_differences(tree, parents, t, tasks[t], places[t], own, share, first, row, work, q, level)


@device_kernel
def _add_differences(tree, parents, t, task, place_of_task, own, share, first, end, work, q, level):
    """The same for a task whose rows are known to first order alone, by central differences.

    Its `own`: of the gradient of its cost, beside Gauss-Newton's part, times a share.
    """
    n, H, C, near, gradient = len(q), work.H[level], work.C, work.part, work.z
    pull, tool, target = work.pull, work.tools[t, 0], work.targets[t]
    if not own:
        for k in range(6):
            pull[k] = pull[k] / task[TaskRow.WEIGHTS + k] if task[TaskRow.WEIGHTS + k] > 0.0 else 0.0
        if place_of_task[Place.KIND] in (Kind.AXIS_ALONG, Kind.AXIS_AT):
            in_base(task, tool, pull)
    for i in range(n):
        near[i] = q[i]
    for i in range(n):
        for j in range(n):
            C[i, j] = 0.0
        for side in range(2):
            step = NUDGE if side == 0 else -NUDGE
            near[i] = q[i] + step
            _slope_at(tree, parents, task, place_of_task, target, own, work, near, gradient)
            for j in range(n):
                C[i, j] += gradient[j] / (2.0 * step)
        near[i] = q[i]
    largest = 0.0
    for i in range(n):
        for j in range(i + 1):
            s = 0.5 * (C[i, j] + C[j, i])
            if own:
                for k in range(first, end):
                    s -= work.rows[k, i] * work.rows[k, j]
            C[i, j], C[j, i] = s, s
            largest = max(largest, abs(s))
    for i in range(n):
        for j in range(n):
            if abs(C[i, j]) >= NOISE * largest:
                H[i, j] += share * C[i, j]


@device_kernel
def _slope_at(tree, parents, task, place_of_task, target, own, work, q, gradient):
    """The gradient (n,) of a task's cost at q (n,), or of its rows times work.pull."""
    poses, tools, rows, J, e = work.near_poses, work.near_tools, work.near_rows, work.near_J, work.off
    forward(tree, parents, q, poses)
    for f in range(3):
        joint = place_of_task[Place.JOINTS + f]
        if joint == Place.ABSENT:
            break
        place(poses, joint, task[TaskRow.PLACEMENTS + 12 * f :], tools[f])
    task_levers(task, place_of_task, tools, target, e, work.levers)
    _add_rows(tree, parents, poses, task, place_of_task, tools, work.levers, work.joints, J, rows, 0)
    if own:
        task_error(task, place_of_task, tools, target, q, e)
        for k in range(6):
            e[k] *= -task[TaskRow.WEIGHTS + k]
    else:
        for k in range(6):
            e[k] = work.pull[k]
        if place_of_task[Place.KIND] in (Kind.AXIS_ALONG, Kind.AXIS_AT):
            across_axis(task, tools[0], e)
    for i in range(len(q)):
        gradient[i] = 0.0
    row = 0
    for k in range(6):
        if task[TaskRow.WEIGHTS + k] > 0.0:
            for i in range(len(q)):
                gradient[i] += e[k] * rows[row, i]
            row += 1


@device_kernel
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
    add_pose_curvature(J[:count], pull, C)
    for a in range(count):
        for b in range(count):
            H[path[a], path[b]] += C[a, b]


@device_kernel
def add_gauss_newton(level, work):
    """Add Gauss-Newton's part to the Hessian of a level; what that was is kept in work.curvature."""
    H, rows = work.H[level], work.rows[work.ends[level - 1] if level > 0 else 0 : work.ends[level]]
    for i in range(len(H)):
        for j in range(i + 1):
            s = H[i, j]
            work.curvature[i, j], work.curvature[j, i] = s, s
            for k in range(len(rows)):
                s += rows[k, i] * rows[k, j]
            H[i, j], H[j, i] = s, s


@device_kernel
def is_reached(e, numbers):
    """Whether an error (6,) is within the tolerances."""
    position, orientation = squares(e)
    return position <= numbers[Step.POSITION_WITHIN] ** 2 and orientation <= numbers[Step.ORIENTATION_WITHIN] ** 2


@device_kernel
def finish_model(tree, places, objectives, numbers, level, bends, is_bent, asked, work, q):
    """The damping of a level with its Hessian in work.H, which curvature it leaves, and which steps it does not take.

    `is_bent` tells that rows above are directions in which their level bends.
    """
    H, largest, left = work.H[level], 0.0, work.left_norms[level]
    for i in range(len(H)):
        for j in range(len(H)):
            largest = max(largest, abs(H[i, j]))
    steep = left * work.gradients[level] / math.sqrt(largest) if largest > 0.0 else 0.0
    mu = numbers[Step.DAMPING] * min(max(steep, STEEP * left * left), left * left, 1.0)
    work.mu[level] = mu + numbers[Step.LEAST_DAMPING] * largest + asked
    stationary = steep <= STATIONARY * left * left and not is_bent
    work.saddle[level] = (SADDLE * left * math.sqrt(largest) if stationary else math.inf) if bends else -1.0
    work.flat[level] = FLAT * left * math.sqrt(largest)
    if objectives[level, Level.WEIGHT] != 0.0:
        work.flat[level] = HESSIAN_THRESHOLD * largest
    reached, square = True, 0.0
    for t in range(len(places)):
        reached = reached and (places[t, Place.LEVEL] != level or is_reached(work.e[t], numbers))
    for k in range(work.ends[level - 1] if level > 0 else 0, work.ends[level]):
        square += work.errors[k] ** 2
    faint = FAINT * math.sqrt(square) if reached else 0.0
    rough = FRICTION * numbers[Step.STATIONARITY] * left if bends else 0.0
    work.still[level] = max(faint, rough) * math.sqrt(largest)
    for i in range(len(H)):
        stands = q[i] - tree[i, Joint.LOWER] <= STANDING or tree[i, Joint.UPPER] - q[i] <= STANDING
        work.leaning[level, i] = work.held[i] and stands
