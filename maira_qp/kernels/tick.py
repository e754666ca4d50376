"""One control tick: the compiled form of `maira_qp.solvers.tick`, where the algorithm is explained."""

from __future__ import annotations

import math

from maira_qp.kernels.bounds import bounds_of_position, bounds_of_tick, rest_of, share_to_stop
from maira_qp.kernels.chain import LOWER, UPPER
from maira_qp.kernels.compilation import bare_kernel, inner_kernel
from maira_qp.kernels.descent import squares
from maira_qp.kernels.hierarchy import solve_each_level
from maira_qp.kernels.levels import (
    DAMPED,
    add_curvature_above,
    finish_hessian,
    level_costs,
    level_damping,
    level_model,
)
from maira_qp.kernels.multipliers import find_multipliers
from maira_qp.kernels.positive_part import make_positive
from maira_qp.kernels.rigid import FINE, pose_row
from maira_qp.kernels.search import FARTHEST_START
from maira_qp.kernels.task_rows import OWN, SOURCE, TARGET
from maira_qp.kernels.tick_memory import make_work
from maira_qp.kernels.tree import VELOCITY

BAD_CONFIGURATION, TOO_FAR = -1, -2

# the entries of `numbers`
DAMPING, LEAST_DAMPING, SMALL_ERROR, HALVINGS, WITHIN, FARTHEST, FEASIBILITY, IS_SLOW = 0, 1, 2, 3, 4, 5, 6, 7
FIRST, ROWS = 8, 9
"""How many tasks are of the first priority, and how many rows all tasks have"""


@bare_kernel
def tick(tree, parents, tasks, places, objectives, numbers, dt, T, q, velocity, memory, index, out):
    """A tick of dt [s] from q (n,) at a velocity (n,) toward the targets T (4 K, 4) of the call.

    `out` (2 n + 2,) becomes the configuration after it, the velocity that leads to it, and what is left of the errors
    of position and orientation. Returns what is wrong with a target, see `rigid`, `TOO_FAR`, or `BAD_CONFIGURATION`;
    then nothing is done. See `levels` and `tree` for the problem; memory and index are as long as `memory_sizes` says.
    """
    n = len(q)
    work = make_work(n, len(tasks), int(numbers[ROWS]), len(objectives), memory, index)
    for i in range(n):
        if not (abs(q[i]) <= FARTHEST_START and abs(velocity[i]) < math.inf):
            return BAD_CONFIGURATION
    fault = _read_targets(tasks, places, numbers, T, work.targets)
    if fault != FINE:
        return fault
    lower, upper, step, trial, held = work.lower, work.upper, work.step, work.trial, work.held
    F, tau, order, joints, A, V = work.F, work.tau, work.order, work.joints, work.A, work.V
    bounds_of_tick(tree, q, velocity, dt, lower, upper)
    for i in range(n):
        held[i] = lower[i] >= 0.0 or upper[i] <= 0.0
    level_costs(tree, parents, tasks, places, objectives, work, q, work.values)
    for level in range(len(objectives)):
        H = work.H[level]
        squared, asked = level_model(tree, parents, tasks, places, objectives, level, work, q)
        if level > 0:
            above = work.rows[: work.ends[level - 1]]
            find_multipliers(above, work.g, held, F, tau, order, joints, work.x, work.M, A, V, work.multipliers)
            add_curvature_above(tasks, places, level, work)
        finish_hessian(objectives, level, work)
        if level == 0:
            make_positive(H, n, A, V)
        mu = level_damping(H, squared, asked, numbers[DAMPING], numbers[LEAST_DAMPING])
        work.mu[level] = mu if objectives[level, DAMPED] != 0.0 else 0.0
    share, solved = 1.0, len(objectives)
    for timeless in range(int(numbers[IS_SLOW]), -1, -1):
        if timeless > 0:
            bounds_of_position(tree, q, lower, upper)
        else:
            bounds_of_tick(tree, q, velocity, dt, lower, upper)
        solved = solve_each_level(objectives, share, work)
        if timeless > 0 and solved > 0:
            share = share_to_stop(tree, work.displacements[solved - 1], dt)
    if not rest_of(lower, upper, step):
        for i in range(n):
            trial[i] = q[i] + step[i]
        level_costs(tree, parents, tasks, places, objectives, work, trial, work.values)
    _take_safe_shares(tree, parents, tasks, places, objectives, numbers, work, q, solved)
    ahead = out[:n]
    for i in range(n):
        low, high, reach = tree[i, LOWER], tree[i, UPPER], tree[i, VELOCITY]
        move = min(max(step[i], lower[i]), upper[i])
        ahead[i] = min(max(q[i] + move, low), high) if low <= q[i] <= high else q[i] + move
        out[n + i] = min(max(move / dt, -reach), reach)
    level_costs(tree, parents, tasks, places, objectives, work, ahead, work.values)
    _report(work.e[: int(numbers[FIRST])], out[2 * n :])
    return FINE


@bare_kernel
def _read_targets(tasks, places, numbers, T, targets):
    """The target of each task as a row of targets (T, 12); what is wrong with one."""
    for t in range(len(tasks)):
        source = places[t, SOURCE]
        if source == OWN:
            for k in range(12):
                targets[t, k] = tasks[t, TARGET + k]
            continue
        fault = pose_row(T[4 * source : 4 * source + 4], numbers[WITHIN], targets[t])
        if fault != FINE:
            return fault
        for k in range(9, 12):
            if abs(targets[t, k]) > numbers[FARTHEST]:
                return TOO_FAR
    return FINE


@inner_kernel
def _take_safe_shares(tree, parents, tasks, places, objectives, numbers, work, q, solved):
    """Add to the `step` what each level adds, halved until the true costs, `values` those of now, allow it."""
    displacements, values, trial_values, highest = work.displacements, work.values, work.trial_values, work.highest
    lower, upper, step, part, trial, solved_above = work.lower, work.upper, work.step, work.part, work.trial, work.dq
    n, slack, small = len(q), numbers[FEASIBILITY], 0.5 * numbers[SMALL_ERROR] ** 2
    for i in range(n):
        solved_above[i] = step[i]
    for level in range(solved):
        before = values[level]
        highest[level] = before + 1e-9 * (1.0 + abs(before)) if level > 0 else before
        for i in range(n):
            part[i] = displacements[level, i] - solved_above[i]
            solved_above[i] = displacements[level, i]
        for _ in range(int(numbers[HALVINGS])):
            allowed = True
            for i in range(n):
                move = step[i] + part[i]
                trial[i] = q[i] + move
                allowed = allowed and lower[i] - slack <= move <= upper[i] + slack
            if allowed:
                level_costs(tree, parents, tasks, places, objectives, work, trial, trial_values)
                for k in range(level + 1):
                    allowed = allowed and trial_values[k] <= highest[k]
            if allowed:
                for i in range(n):
                    step[i] += part[i]
                for k in range(len(values)):
                    values[k] = trial_values[k]
                break
            for i in range(n):
                part[i] *= 0.5
        highest[level] = max(0.5 * (before + values[level]), small)


@bare_kernel
def _report(e, left):
    """The largest errors of position [m] and orientation [rad] among e (T, 6) into left (2,)."""
    left[0], left[1] = 0.0, 0.0
    for error in e:
        position, orientation = squares(error)
        left[0], left[1] = max(left[0], math.sqrt(position)), max(left[1], math.sqrt(orientation))
