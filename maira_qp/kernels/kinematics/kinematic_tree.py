"""Kinematics of a tree of joints that all move along or about their own z axis.

A tree of n joints is one array (n, 19) and `parents` (n,) of int64, each before its children, -1 for the base. Row i is
that of `kernels.kinematics.serial_chain`, its placement that of joint i in the frame of its parent, and after it come
the largest speed [17] and acceleration [18]. A chain is a tree.
"""

from __future__ import annotations

from maira_qp.kernels.jit.decorators import kernel
from maira_qp.kernels.jit.simd_trig import sine_cosine
from maira_qp.kernels.layout import Joint

BASE = -1
"""The parent of a joint that stands on the base."""


@kernel
def forward(tree, parents, q, poses):
    """Poses (n, 12), R by rows and p, of the frames behind the joints, at q (n,)."""
    for i in range(len(q)):
        pose = poses[i]
        place(poses, parents[i], tree[i], pose)
        if tree[i, Joint.PRISMATIC] != 0.0:
            for row in range(3):
                pose[9 + row] += q[i] * pose[3 * row + 2]
        else:
            s, c = sine_cosine(q[i])
            for row in range(3):
                x, y = pose[3 * row], pose[3 * row + 1]
                pose[3 * row], pose[3 * row + 1] = c * x + s * y, c * y - s * x


@kernel
def place(poses, joint, placement, pose):
    """The pose (12,) of what is placed so behind a joint, or on the base; of `placement` the first twelve count."""
    if joint < 0:
        for k in range(12):
            pose[k] = placement[k]
        return
    behind = poses[joint]
    for row in range(3):
        x, y, z = behind[3 * row], behind[3 * row + 1], behind[3 * row + 2]
        for k in range(3):
            pose[3 * row + k] = x * placement[k] + y * placement[3 + k] + z * placement[6 + k]
        pose[9 + row] = behind[9 + row] + (x * placement[9] + y * placement[10] + z * placement[11])


@kernel
def path_to(parents, joint, path):
    """The joints that carry what is behind a joint, the first of them first, into `path`: how many."""
    count, i = 0, joint
    while i >= 0:
        count, i = count + 1, parents[i]
    i = joint
    for a in range(count - 1, -1, -1):
        path[a] = i
        i = parents[i]
    return count


@kernel
def path_jacobian(tree, poses, path, pose, J):
    """Jacobian of a pose into J (k, 6), transposed: row a is [linear, angular] of joint path[a], base axes."""
    for a in range(len(J)):
        i = path[a]
        x, y, z = poses[i, 2], poses[i, 5], poses[i, 8]
        if tree[i, Joint.PRISMATIC] != 0.0:
            J[a, 0], J[a, 1], J[a, 2] = x, y, z
            J[a, 3], J[a, 4], J[a, 5] = 0.0, 0.0, 0.0
        else:
            dx, dy, dz = pose[9] - poses[i, 9], pose[10] - poses[i, 10], pose[11] - poses[i, 11]
            J[a, 0], J[a, 1], J[a, 2] = y * dz - z * dy, z * dx - x * dz, x * dy - y * dx
            J[a, 3], J[a, 4], J[a, 5] = x, y, z
