"""The pose error by the quaternion logarithm: the compiled form of `maira_qp.orientation.pose_error`."""

from __future__ import annotations

from maira_qp.kernels.jit.decorators import kernel
from maira_qp.kernels.jit.simd import any_lane, load, maximum, select, square_root, store


@kernel
def pose_error(tool, target, e):
    """Error of a pose (12,), R by rows and p, against the target (12,) into e (6,): [p_d - p; 2 log(quat(R_d R^T))]."""
    t0, t1, t2, t3, t4 = load(tool, 0), load(tool, 1), load(tool, 2), load(tool, 3), load(tool, 4)
    t5, t6, t7, t8 = load(tool, 5), load(tool, 6), load(tool, 7), load(tool, 8)
    g0, g1, g2, g3, g4 = load(target, 0), load(target, 1), load(target, 2), load(target, 3), load(target, 4)
    g5, g6, g7, g8 = load(target, 5), load(target, 6), load(target, 7), load(target, 8)
    store(e, 0, load(target, 9) - load(tool, 9))
    store(e, 1, load(target, 10) - load(tool, 10))
    store(e, 2, load(target, 11) - load(tool, 11))
    # M = R_d R^T
    m00 = g0 * t0 + g1 * t1 + g2 * t2
    m11 = g3 * t3 + g4 * t4 + g5 * t5
    m22 = g6 * t6 + g7 * t7 + g8 * t8
    # vee(M - M^T), from (R_d - R) R^T: no cancellation where the two are close
    d0, d1, d2, d3, d4, d5, d6, d7, d8 = g0 - t0, g1 - t1, g2 - t2, g3 - t3, g4 - t4, g5 - t5, g6 - t6, g7 - t7, g8 - t8
    sx = d6 * t3 + d7 * t4 + d8 * t5 - (d3 * t6 + d4 * t7 + d5 * t8)
    sy = d0 * t6 + d1 * t7 + d2 * t8 - (d6 * t0 + d7 * t1 + d8 * t2)
    sz = d3 * t0 + d4 * t1 + d5 * t2 - (d0 * t3 + d1 * t4 + d2 * t5)
    # four times a quaternion, each component times the same one: that with the largest square is the safe one
    ww, xx, yy, zz = 1.0 + m00 + m11 + m22, 1.0 + m00 - m11 - m22, 1.0 - m00 + m11 - m22, 1.0 - m00 - m11 + m22
    w, x, y, z = ww, sx, sy, sz
    largest = maximum(maximum(ww, xx), maximum(yy, zz))
    if any_lane(ww < largest):
        xy = g3 * t0 + g4 * t1 + g5 * t2 + (g0 * t3 + g1 * t4 + g2 * t5)
        xz = g0 * t6 + g1 * t7 + g2 * t8 + (g6 * t0 + g7 * t1 + g8 * t2)
        yz = g6 * t3 + g7 * t4 + g8 * t5 + (g3 * t6 + g4 * t7 + g5 * t8)
        by_w, by_x, by_y = ww >= largest, xx >= largest, yy >= largest
        w = select(by_w, ww, select(by_x, sx, select(by_y, sy, sz)))
        x = select(by_w, sx, select(by_x, xx, select(by_y, xy, xz)))
        y = select(by_w, sy, select(by_x, xy, select(by_y, yy, yz)))
        z = select(by_w, sz, select(by_x, xz, select(by_y, yz, zz)))
        long_way = w < 0.0
        w, x = select(long_way, -w, w), select(long_way, -x, x)
        y, z = select(long_way, -y, y), select(long_way, -z, z)
    square = x * x + y * y + z * z
    norm = square_root(square)
    # atan2(norm, w) is twice the arctangent of this, which lies in [0, 1]
    half = norm / (w + square_root(square + w * w))
    factor = select(norm > 0.0, 4.0 * arctangent(half) / norm, 0.0)
    store(e, 3, factor * x)
    store(e, 4, factor * y)
    store(e, 5, factor * z)


@kernel
def arctangent(t):
    """atan t [rad] for t in [0, 1], to the last digit or two.

    Above tan(pi/8) it is pi/4 + atan((t - 1)/(t + 1)); below, x + x^3 p(x^2) with the polynomial p that comes nearest
    to atan in the sense of Chebyshev, found with mpmath's `chebyfit` to 5e-20.
    """
    far = t > 0.41421356237309503
    x = select(far, (t - 1.0) / (t + 1.0), t)
    z = x * x
    p = z * 0.015113765096600924669 - 0.033387824501211951519
    p = p * z + 0.044995007289840320092
    p = p * z - 0.052173125740615910016
    p = p * z + 0.058768340046141606641
    p = p * z - 0.066662052599765261879
    p = p * z + 0.076922810999377432501
    p = p * z - 0.090909080590311910269
    p = p * z + 0.11111111085322108759
    p = p * z - 0.14285714285329708164
    p = p * z + 0.19999999999997013892
    p = p * z - 0.33333333333333324206
    y = x + x * (z * p)
    return select(far, 0.7853981633974483 + y, y)
