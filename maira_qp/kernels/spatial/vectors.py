"""Vectors of three numbers, as tuples: the compiler keeps them in registers."""

from __future__ import annotations

import math

from maira_qp.kernels.jit.decorators import kernel


@kernel
def dot(a, b):
    """a . b"""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def cross(a, b):
    """a x b"""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@kernel
def scaled(s, a):
    """s a"""
    return s * a[0], s * a[1], s * a[2]


@kernel
def minus(a, b):
    """a - b"""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@kernel
def length(a):
    """|a|"""
    return math.sqrt(dot(a, a))


@kernel
def across_most(a):
    """The product of a and the first of the base axes that is most across it: across a, never zero."""
    x, y, z = abs(a[0]), abs(a[1]), abs(a[2])
    if x <= y and x <= z:
        return 0.0, a[2], -a[1]
    if y <= z:
        return -a[2], 0.0, a[0]
    return a[1], -a[0], 0.0


@kernel
def origin(pose):
    """p of a pose (12,), R by rows and p."""
    return pose[9], pose[10], pose[11]


@kernel
def turned(pose, a):
    """R a"""
    x, y, z = a
    return (
        pose[0] * x + pose[1] * y + pose[2] * z,
        pose[3] * x + pose[4] * y + pose[5] * z,
        pose[6] * x + pose[7] * y + pose[8] * z,
    )


@kernel
def turned_back(pose, a):
    """R^T a"""
    x, y, z = a
    return (
        pose[0] * x + pose[3] * y + pose[6] * z,
        pose[1] * x + pose[4] * y + pose[7] * z,
        pose[2] * x + pose[5] * y + pose[8] * z,
    )
