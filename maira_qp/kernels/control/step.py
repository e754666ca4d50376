"""One control tick: the compiled form of `solvers.reference.step`, where the algorithm is explained."""

from __future__ import annotations

import math

from maira_qp.kernels.control.displacement_bounds import (
    bounds_of_position,
    bounds_of_tick,
    keep_along,
    rest_of,
    share_to_stop,
)
from maira_qp.kernels.control.hierarchical_qp import solve_each_level
from maira_qp.kernels.control.level_models import (
    add_curvature,
    add_gauss_newton,
    fade_posture,
    finish_model,
    is_reached,
    level_costs,
    level_model,
    note_start,
    note_where,
    row_changes,
)
from maira_qp.kernels.control.residual import add_bent_directions, factor_above, find_residual
from maira_qp.kernels.control.step_workspace import carve_step_work
from maira_qp.kernels.jit.decorators import device_kernel, kernel
from maira_qp.kernels.layout import Joint, Level, Place, Step, TaskRow
from maira_qp.kernels.linalg.ldl import solve_ldl
from maira_qp.kernels.search.levenberg_marquardt import squares
from maira_qp.kernels.search.multi_start import FARTHEST_START
from maira_qp.kernels.spatial.pose_validation import FINE, pose_row

BAD_CONFIGURATION, TOO_FAR = -1, -2

ARMIJO, ROUNDING, AT_REST, RETURNS = 0.05, 1e-14, 1e-6, 2
"""As in `solvers.reference.safe_steps` and `.step`."""

ARRIVED, MOVING, NEAREST, STUCK = 0.0, 1.0, 2.0, 3.0
"""As `maira_qp.StepStatus`."""


@kernel
def tick(tree, parents, tasks, places, objectives, numbers, dt, T, q, velocity, memory, index, out):
    """A tick of dt [s] from q (n,) at a velocity (n,) toward the targets T (4 K, 4) of the call.

    `out` (2 n + 3,) becomes the configuration after it, the velocity that leads to it, what is left of the errors of
    position and orientation, and the status. Returns what is wrong with a target, see `rigid`, `TOO_FAR`, or
    `BAD_CONFIGURATION`; then nothing is done.

    See `levels` and `tree` for the problem; memory and index are as long as `STEP_WORK` says.
    """
    n = len(q)
    work = carve_step_work(n, len(tasks), int(numbers[Step.ROWS]), len(objectives), memory, index)
    for i in range(n):
        if not (abs(q[i]) <= FARTHEST_START and abs(velocity[i]) < math.inf):
            return BAD_CONFIGURATION
    fault = _read_targets(tasks, places, numbers, T, work.targets)
    if fault != FINE:
        return fault
    lower, upper, step, trial, way = work.lower, work.upper, work.step, work.trial, work.way
    work.fade[0] = 1.0
    level_costs(tree, parents, tasks, places, objectives, work, q, work.values)
    note_start(work)
    is_bent = False
    for level in range(len(objectives)):
        asked = level_model(tree, parents, tasks, places, objectives, level, work, q)
        if level == 0 and numbers[Step.FADING] > 0.0:
            fade_posture(objectives, numbers[Step.FADING], work, q)
        bends = find_residual(tree, objectives, level, work, q, dt)
        add_curvature(tree, parents, tasks, places, level, bends, work, q)
        add_gauss_newton(level, work)
        finish_model(tree, places, objectives, numbers, level, bends, is_bent, asked, work, q)
        if level + 1 < len(objectives) and (bends or objectives[level, Level.WEIGHT] != 0.0):
            is_bent = (add_bent_directions(tree, objectives, level, work) and bends) or is_bent
    share, solved = 1.0, len(objectives)
    is_slow = int(numbers[Step.IS_SLOW])
    for timeless in range(is_slow, -1, -1):
        if timeless > 0:
            bounds_of_position(tree, q, lower, upper)
        else:
            bounds_of_tick(tree, q, velocity, dt, lower, upper)
            if is_slow > 0:
                share = share_to_stop(tree, way, dt)
                keep_along(tree, way, dt, lower, upper)
        solved = solve_each_level(objectives, share, work)
        if not rest_of(lower, upper, step) or timeless < is_slow:
            for i in range(n):
                trial[i] = q[i] + step[i]
            level_costs(tree, parents, tasks, places, objectives, work, trial, work.values)
        most_loss = math.inf if timeless > 0 else 1.0
        _take_safe_shares(tree, parents, tasks, places, objectives, numbers, work, q, solved, most_loss)
        for i in range(n):
            way[i] = step[i]
    ahead = out[:n]
    for i in range(n):
        low, high, reach = tree[i, Joint.LOWER], tree[i, Joint.UPPER], tree[i, Joint.VELOCITY]
        move = min(max(step[i], lower[i]), upper[i])
        ahead[i] = min(max(q[i] + move, low), high) if low <= q[i] <= high else q[i] + move
        out[n + i] = min(max(move / dt, -reach), reach)
    level_costs(tree, parents, tasks, places, objectives, work, ahead, work.values)
    _report(work.e[: int(numbers[Step.FIRST])], out[2 * n :])
    out[2 * n + 2] = _status(tree, tasks, places, numbers, work, solved, dt, out[n : 2 * n])
    return FINE


@device_kernel
def _read_targets(tasks, places, numbers, T, targets):
    """The target of each task as a row of targets (T, 12); what is wrong with one."""
    for t in range(len(tasks)):
        source = places[t, Place.SOURCE]
        if source == Place.OWN:
            for k in range(12):
                targets[t, k] = tasks[t, TaskRow.TARGET + k]
            continue
        fault = pose_row(T[4 * source : 4 * source + 4], numbers[Step.WITHIN], targets[t])
        if fault != FINE:
            return fault
        for k in range(9, 12):
            if abs(targets[t, k]) > numbers[Step.FARTHEST]:
                return TOO_FAR
    return FINE


@device_kernel
def _take_safe_shares(tree, parents, tasks, places, objectives, numbers, work, q, solved, most_loss):
    """Add to the `step` what each level adds, shortened until the true costs, `values` those of now, allow it.

    The levels above may lose up to `most_loss` times what the options let them.
    """
    displacements, values, trial_values, kept = work.displacements, work.values, work.trial_values, work.kept
    lower, upper, step, part, trial, solved_above = work.lower, work.upper, work.step, work.part, work.trial, work.dq
    n, slack, changes, held, move = len(q), numbers[Step.FEASIBILITY], work.changes, work.held, work.y
    for i in range(n):
        solved_above[i] = step[i]
    for level in range(solved):
        before, slope = values[level], 0.0
        H, c, mu, multipliers = work.H[level], work.c[level], work.mu[level], work.balances[level]
        rows = work.ends[level - 1] if level > 0 else 0
        for k in range(rows):
            changes[k] = 0.0
        note_where(work)
        for i in range(n):
            s = c[i] + mu * solved_above[i]
            for j in range(n):
                s += H[i, j] * solved_above[j]
            part[i] = displacements[level, i] - solved_above[i]
            slope += s * part[i]
        for i in range(n):
            solved_above[i] = displacements[level, i]
        share, most = _share_inside(lower, upper, step, part, slack), before + ROUNDING * (1.0 + abs(before))
        slope, done = ARMIJO * min(slope, 0.0), False
        returns, factored = RETURNS if rows > 0 and most_loss < math.inf else 0, False
        for _ in range(int(numbers[Step.HALVINGS])):
            shrink, off = 0.5, 0.0
            for i in range(n):
                move[i] = step[i] + share * part[i]
            for given in range(returns + 1):
                if not _is_inside(lower, upper, move, slack):
                    shrink, done = 0.8 if given > 0 else 0.5, False
                    break
                for i in range(n):
                    trial[i] = q[i] + move[i]
                level_costs(tree, parents, tasks, places, objectives, work, trial, trial_values)
                row_changes(tasks, places, level, work, changes)
                loss, merit = _loss(tasks, places, objectives, numbers, level, work), trial_values[level]
                for k in range(rows if most_loss < math.inf else 0):
                    merit -= multipliers[k] * changes[k]
                done = loss <= most_loss and merit <= most + share * slope
                shrink = 0.5 if loss <= most_loss else max(0.1, min(0.9 / math.sqrt(loss), 0.8))
                off, before_it = _size(changes, rows), off
                if given == returns or (done and off <= numbers[Step.ORIENTATION_LOSS]):
                    break
                if given > 0 and off > 0.5 * before_it:
                    break  # too long a way for rows of where it began
                if not factored:
                    for i in range(n):
                        held[i] = not (lower[i] + slack < displacements[level, i] < upper[i] - slack)
                    factor_above(work.rows[:rows], held, work.gram, work.factor)
                    factored = True
                _give_back(rows, work, move)
            if done:
                break
            share *= shrink
        if done:
            for i in range(n):
                step[i] = move[i]
            for k in range(len(values)):
                values[k] = trial_values[k]
        elif level + 1 < solved:
            for i in range(n):
                trial[i] = q[i] + step[i]
            level_costs(tree, parents, tasks, places, objectives, work, trial, values)
        for t in range(len(tasks)):
            if places[t, Place.LEVEL] == level:
                position, orientation = squares(work.e[t])
                kept[t, 0], kept[t, 1] = math.sqrt(position), math.sqrt(orientation)
        work.highest[level] = values[level]


@device_kernel
def _is_inside(lower, upper, move, slack):
    """Whether a displacement (n,) is within bounds, but for a slack."""
    inside = True
    for i in range(len(move)):
        inside = inside and lower[i] - slack <= move[i] <= upper[i] + slack
    return inside


@device_kernel
def _share_inside(lower, upper, step, part, slack):
    """The largest share of a part (n,) that bounds allow after a step (n,), which is inside."""
    share = 1.0
    for i in range(len(step)):
        move = step[i] + part[i]
        if move > upper[i] + slack:
            share = min(share, (upper[i] - step[i]) / part[i])
        elif move < lower[i] - slack:
            share = min(share, (lower[i] - step[i]) / part[i])
    return max(share, 0.0)


@device_kernel
def _size(changes, rows):
    """Length of some changes."""
    square = 0.0
    for k in range(rows):
        square += changes[k] * changes[k]
    return math.sqrt(square)


@device_kernel
def _give_back(rows, work, move):
    """Add to a displacement (n,) the least that gives the levels above what it took from them, by their rows at q."""
    held, y, K = work.held, work.weights, work.rows
    for k in range(rows):
        y[k] = work.changes[k]
    solve_ldl(work.factor, rows, y)
    for i in range(len(move)):
        for k in range(rows):
            move[i] += 0.0 if held[i] else K[k, i] * y[k]


@device_kernel
def _loss(tasks, places, objectives, numbers, level, work):
    """What the levels above one lose, the largest share of what they may."""
    loss, e, kept = -1.0, work.e, work.kept
    for t in range(len(tasks)):
        if places[t, Place.LEVEL] >= level:
            break
        position, orientation = squares(e[t])
        loss = max(loss, (math.sqrt(position) - kept[t, 0]) / numbers[Step.POSITION_LOSS])
        loss = max(loss, (math.sqrt(orientation) - kept[t, 1]) / numbers[Step.ORIENTATION_LOSS])
    for k in range(level):
        if objectives[k, Level.WEIGHT] != 0.0:
            loss = max(loss, (work.trial_values[k] - work.highest[k]) / (0.5 * numbers[Step.ORIENTATION_LOSS] ** 2))
    return loss


@device_kernel
def _status(tree, tasks, places, numbers, work, solved, dt, velocity):
    """What the arm is doing after a tick, from the errors in work.e and what the QPs asked for."""
    arrived, moving, wanted, slowly, gain = True, False, solved == 0 or work.unsolved[0] > 0.0, False, 1.0
    for error in work.e[: len(places)]:
        arrived = arrived and is_reached(error, numbers)
    if arrived:
        return ARRIVED
    for task in tasks:
        gain = min(gain, task[TaskRow.GAIN])
    for i in range(len(velocity)):
        slow = AT_REST * (tree[i, Joint.VELOCITY] if tree[i, Joint.VELOCITY] < math.inf else 1.0)
        moving = moving or abs(velocity[i]) > slow
        way = abs(work.displacements[solved - 1, i]) if solved > 0 else 0.0
        wanted, slowly = wanted or way > slow * dt, slowly or way > slow * dt * gain
    if moving:
        return MOVING
    if wanted:
        return STUCK
    return MOVING if slowly else NEAREST


@device_kernel
def _report(e, left):
    """The largest errors of position [m] and orientation [rad] among e (T, 6) into left (2,)."""
    left[0], left[1] = 0.0, 0.0
    for error in e:
        position, orientation = squares(error)
        left[0], left[1] = max(left[0], math.sqrt(position)), max(left[1], math.sqrt(orientation))
