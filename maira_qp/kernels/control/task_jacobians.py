"""The tasks of a tick: their errors, and the rows by which these fall, kind by kind.

Every task has an error e (6,), [m] in the first three entries and [rad] in the last, and weights (6,), 0 where nothing
counts. Tasks of frames have levers too: the derivative of `-e` by the twists of up to three frames, (6, 6) each, which
times the Jacobians of the frames are the rows. The joints' own tasks have their coefficients in place of levers, and a
task that damps has one row a joint and no error. The definitions are in `problem.tasks`.

`tasks` (T, 60 + n) and `places` (T, 7) of int64 hold the columns below. A pose (12,) is R by rows, then p.
"""

from __future__ import annotations

import math

from maira_qp.kernels.jit.decorators import device_kernel, kernel
from maira_qp.kernels.layout import Axes, Kind, Place, TaskRow
from maira_qp.kernels.spatial.pose_error import pose_error
from maira_qp.kernels.spatial.so3 import bend_of_even_cost, bend_of_logarithm, inverse_right_jacobian
from maira_qp.kernels.spatial.vectors import (
    across_most,
    cross,
    dot,
    length,
    minus,
    origin,
    scaled,
    turned,
    turned_back,
)

SMALL = 1e-9
"""As in `problem.tasks.axis` and `.swivel`: shorter lengths [m] have no direction."""


@kernel
def task_error(task, place, tools, target, q, e):
    """The error of a task at q (n,) into e (6,), from the poses of its frames, tools (3, 12), and its target (12,)."""
    kind = place[Place.KIND]
    if kind == Kind.POSE:
        _frame_error(task, place, tools[0], target, e)
        return
    for k in range(6):
        e[k] = 0.0
    if kind in (Kind.AXIS_ALONG, Kind.AXIS_AT):
        _direction_error(task, kind, tools[0], target, e)
    elif kind == Kind.RELATIVE:
        seen_from(tools[1], tools[0], tools[2])
        pose_error(tools[2], target, e)
        _drop_free_rows(task, e)
    elif kind == Kind.SWIVEL:
        e[3] = _missing_swivel(task, tools)
    elif kind == Kind.COUPLING:
        e[3] = task[TaskRow.VALUE]
        for i in range(len(q)):
            e[3] -= task[TaskRow.COEFFICIENTS + i] * q[i]


@device_kernel
def _frame_error(task, place, tool, target, e):
    pose_error(tool, target, e)
    if place[Place.AXES] == Axes.TARGET:
        e[0], e[1], e[2] = turned_back(target, (e[0], e[1], e[2]))
        e[3], e[4], e[5] = turned_back(target, (e[3], e[4], e[5]))
    _drop_free_rows(task, e)


@device_kernel
def _drop_free_rows(task, e):
    """The entries of an error (6,) that do not count become 0."""
    for k in range(6):
        if task[TaskRow.WEIGHTS + k] == 0.0:
            e[k] = 0.0


@device_kernel
def _direction_error(task, kind, tool, target, e):
    """The rotation vector that takes the axis a to the direction d, along the two axes across a."""
    a, (d, _) = _axis(task, tool), _direction(task, kind, tool, target)
    first, second = _across(a)
    turn = _turn_between(a, d)
    e[3], e[4] = dot(turn, first), dot(turn, second)


@device_kernel
def _axis(task, tool):
    """The axis of the tool that is to point somewhere, a unit vector."""
    return turned(tool, (task[TaskRow.AXIS], task[TaskRow.AXIS + 1], task[TaskRow.AXIS + 2]))


@device_kernel
def _direction(task, kind, tool, target):
    """The unit vector that the axis is to point along, and one over the distance [m] of what it points at, or 0."""
    if kind == Kind.AXIS_ALONG:
        return turned(target, (task[TaskRow.AXIS], task[TaskRow.AXIS + 1], task[TaskRow.AXIS + 2])), 0.0
    away = minus(origin(target), origin(tool))
    distance = length(away)
    if distance > SMALL:
        return scaled(1.0 / distance, away), 1.0 / distance
    return (0.0, 0.0, 1.0), 1.0 / SMALL


@device_kernel
def _across(a):
    """Two unit vectors that are a right-handed frame with the unit vector a."""
    first = across_most(a)
    first = scaled(1.0 / length(first), first)
    return first, cross(a, first)


@kernel
def measure_turn(task, place, here, before, after, target, change):
    """The turning part of a task's `change` (6,) of error, as its rows tell it, between places of its frames (3, 12).

    As `problem.tasks.task.Task.change`, `here` (12,) the first frame where the rows are from. What the rows tell as the
    derivative of the error stays as it is.
    """
    kind = place[Place.KIND]
    if kind == Kind.SWIVEL:
        change[3] -= 2.0 * math.pi * math.floor(change[3] / (2.0 * math.pi) + 0.5)
    elif kind in (Kind.AXIS_ALONG, Kind.AXIS_AT):
        first, second = _across(_axis(task, here))
        back = _turn_back(task, kind, before[0], after[0], target)
        change[3], change[4] = dot(back, first), dot(back, second)
    elif kind in (Kind.POSE, Kind.RELATIVE) and _turns_evenly(task):
        x, y, z = change[0], change[1], change[2]
        seen = 0 if kind == Kind.POSE else 2
        pose_error(after[seen], before[seen], change)
        change[0], change[1], change[2] = x, y, z
        if place[Place.AXES] == Axes.TARGET:
            change[3], change[4], change[5] = turned_back(target, (change[3], change[4], change[5]))


@device_kernel
def _turn_back(task, kind, before, after, target):
    """The turn that takes the axis back to where it was, as seen from the direction that it is to point along."""
    own = _turn_between(_axis(task, after), _axis(task, before))
    if kind == Kind.AXIS_ALONG:
        return own
    return minus(
        own, _turn_between(_direction(task, kind, after, target)[0], _direction(task, kind, before, target)[0])
    )


@device_kernel
def _turn_between(a, b):
    """The rotation vector that takes a unit vector to another, the short way."""
    turn, along = cross(a, b), dot(a, b)
    sine = length(turn)
    angle = math.atan2(sine, along)
    if sine < 1e-12 and along < 0.0:
        turn, angle = across_most(a), math.pi
        sine = length(turn)
    return scaled(angle / sine if sine > 0.0 else 0.0, turn)


@kernel
def in_base(task, tool, pull):
    """What pulls the two rows of a direction, pull[3:5], as a vector in base axes, pull[:3]."""
    first, second = _across(_axis(task, tool))
    u, v = pull[3], pull[4]
    for k in range(3):
        pull[k] = u * first[k] + v * second[k]


@kernel
def across_axis(task, tool, pull):
    """The part of a vector in base axes, pull[:3], for the two rows of a direction, pull[3:5]."""
    first, second = _across(_axis(task, tool))
    vector = pull[0], pull[1], pull[2]
    pull[3], pull[4] = dot(vector, first), dot(vector, second)


@kernel
def seen_from(reference, pose, seen):
    """The pose `reference^-1 pose` into seen (12,)."""
    for k in range(3):
        seen[k], seen[3 + k], seen[6 + k] = turned_back(reference, (pose[k], pose[3 + k], pose[6 + k]))
    seen[9], seen[10], seen[11] = turned_back(reference, minus(origin(pose), origin(reference)))


@device_kernel
def _missing_swivel(task, tools):
    """The turn of the elbow about the line from shoulder to wrist that is missing, the short way round."""
    elbow, side, up, _ = _elbow_plane(task, tools)
    x, y = dot(elbow, up), dot(elbow, side)
    if math.sqrt(x * x + y * y) < SMALL:
        return 0.0
    missing = task[TaskRow.VALUE] - math.atan2(y, x)
    return missing - 2.0 * math.pi * math.floor(missing / (2.0 * math.pi) + 0.5)


@device_kernel
def _elbow_plane(task, tools):
    """The elbow from the shoulder [m], both axes of the circle's plane, and the vector from shoulder to wrist [m]."""
    reference = task[TaskRow.AXIS], task[TaskRow.AXIS + 1], task[TaskRow.AXIS + 2]
    line = minus(origin(tools[2]), origin(tools[0]))
    along = scaled(1.0 / max(length(line), SMALL), line)
    up = minus(reference, scaled(dot(along, reference), along))
    if length(up) < SMALL:
        up = across_most(along)
    up = scaled(1.0 / length(up), up)
    return minus(origin(tools[1]), origin(tools[0])), cross(along, up), up, line


@kernel
def task_levers(task, place, tools, target, e, levers):
    """The derivative of `-e` by the twist of each frame, in base axes, into levers (3, 6, 6). Work: e (6,).

    Where the angular rows of a pose count the same, its levers are those of the pose itself: the gradient is the same.
    """
    kind = place[Place.KIND]
    for f in range(3):
        for k in range(6):
            for j in range(6):
                levers[f, k, j] = 0.0
    if kind == Kind.POSE:
        _frame_lever(task, place, tools[0], target, e, levers[0])
    elif kind in (Kind.AXIS_ALONG, Kind.AXIS_AT):
        _direction_lever(task, kind, tools[0], target, levers[0])
    elif kind == Kind.RELATIVE:
        _relative_levers(task, tools, target, e, levers)
    elif kind == Kind.SWIVEL:
        _swivel_levers(task, tools, levers)


@kernel
def pose_bend(task, place, tool, target, of_cost, pull, e, inverse, S):
    """How the rows of a pose bend, weighted by pull (6,): as its frame weighted by what becomes of pull, and S (3, 3).

    S is what two turns of the frame add. Rows whose turns count the same bend as the frame's pose does, others as the
    error. For the pull of a cost it is what this bends beside Gauss-Newton's part. Work: e (6,), inverse (3, 3).
    """
    if place[Place.AXES] == Axes.TARGET:
        pull[0], pull[1], pull[2] = turned(target, (pull[0], pull[1], pull[2]))
        pull[3], pull[4], pull[5] = turned(target, (pull[3], pull[4], pull[5]))
    even = _turns_evenly(task)
    if even and not of_cost:
        for i in range(3):
            for j in range(3):
                S[i, j] = 0.0
        return
    pose_error(tool, target, e)
    phi, u = (e[3], e[4], e[5]), (pull[3], pull[4], pull[5])
    if even:
        square = max(task[TaskRow.WEIGHTS + 3] * task[TaskRow.WEIGHTS + 3], 1e-300)
        bend_of_even_cost((-u[0] / square, -u[1] / square, -u[2] / square), task[TaskRow.WEIGHTS + 3], S)
        return
    inverse_right_jacobian(phi, inverse)
    bend_of_logarithm(phi, u, inverse, S)
    for k in range(3):
        pull[3 + k] = inverse[0, k] * u[0] + inverse[1, k] * u[1] + inverse[2, k] * u[2]


@device_kernel
def _turns_evenly(task):
    """The angular rows of a pose count the same each."""
    return task[TaskRow.WEIGHTS + 3] == task[TaskRow.WEIGHTS + 4] == task[TaskRow.WEIGHTS + 5]


@device_kernel
def _frame_lever(task, place, tool, target, e, lever):
    angular = lever[3:, 3:]
    if _turns_evenly(task):
        for k in range(3):
            angular[k, k] = 1.0
    else:
        pose_error(tool, target, e)
        inverse_right_jacobian((e[3], e[4], e[5]), angular)
    for k in range(3):
        lever[k, k] = 1.0
    if place[Place.AXES] == Axes.TARGET:
        for k in range(3):
            lever[0, k], lever[1, k], lever[2, k] = turned_back(target, (lever[0, k], lever[1, k], lever[2, k]))
            angular[0, k], angular[1, k], angular[2, k] = turned_back(
                target, (angular[0, k], angular[1, k], angular[2, k])
            )


@device_kernel
def _direction_lever(task, kind, tool, target, lever):
    """What turns the axis counts, but for a turn about itself; and what moves it past the point that it looks at."""
    d, nearness = _direction(task, kind, tool, target)
    first, second = _across(_axis(task, tool))
    past, beside = cross(first, d), cross(second, d)
    for k in range(3):
        lever[3, k], lever[3, 3 + k] = nearness * past[k], first[k]
        lever[4, k], lever[4, 3 + k] = nearness * beside[k], second[k]


@device_kernel
def _relative_levers(task, tools, target, e, levers):
    """The frame's own twist, and minus that of the reference, which carries the frame along.

    As seen from the reference; where the angular rows count differently, with the derivative of the logarithm.
    """
    reference, off = tools[1], minus(origin(tools[0]), origin(tools[1]))
    for k in range(3):
        axis = reference[k], reference[3 + k], reference[6 + k]
        carried = cross(axis, off)
        for j in range(3):
            levers[0, k, j], levers[0, 3 + k, 3 + j] = axis[j], axis[j]
            levers[1, k, j], levers[1, 3 + k, 3 + j] = -axis[j], -axis[j]
            levers[1, k, 3 + j] = carried[j]
    if _turns_evenly(task):
        return
    seen_from(tools[1], tools[0], tools[2])
    pose_error(tools[2], target, e)
    inverse = levers[2, :3, :3]
    inverse_right_jacobian((e[3], e[4], e[5]), inverse)
    for f in range(2):
        for j in range(3, 6):
            x, y, z = levers[f, 3, j], levers[f, 4, j], levers[f, 5, j]
            for k in range(3):
                levers[f, 3 + k, j] = inverse[k, 0] * x + inverse[k, 1] * y + inverse[k, 2] * z
    for k in range(3):
        for j in range(3):
            inverse[k, j] = 0.0


@device_kernel
def _swivel_levers(task, tools, levers):
    """Of shoulder, elbow and wrist: psi = atan2(y, x), both in a frame that turns with the line shoulder-wrist."""
    elbow, side, up, line = _elbow_plane(task, tools)
    x, y = dot(elbow, up), dot(elbow, side)
    square, distance = x * x + y * y, max(length(line), SMALL)
    if math.sqrt(square) < SMALL:
        return
    reference, along = (task[TaskRow.AXIS], task[TaskRow.AXIS + 1], task[TaskRow.AXIS + 2]), cross(up, side)
    lift = dot(reference, up)
    turn = dot(reference, along) / lift if lift > SMALL else 0.0
    for k in range(3):
        across = (x * side[k] - y * up[k]) / square
        swing = (dot(elbow, along) * across - turn * side[k]) / distance
        levers[0, 3, k], levers[1, 3, k], levers[2, 3, k] = swing - across, across, -swing
