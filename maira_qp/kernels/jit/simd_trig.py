"""Sine and cosine together, in one lane or eight, several times faster than two calls of the C library.

The angle is brought to [-pi/4, pi/4] by a multiple of pi/2 that is subtracted in three parts (Cody and Waite, "Software
manual for the elementary functions", 1980), and both series of Taylor are summed to below rounding there. Up to 1e5 rad
the last digit or two may differ from the C library's; beyond, the error grows with the angle.
"""

from __future__ import annotations

from maira_qp.kernels.jit.decorators import kernel
from maira_qp.kernels.jit.simd import floor, select

PI_2_A, PI_2_B, PI_2_C = 1.5707963267341256, 6.077100506303966e-11, 2.0222662487959506e-21
"""pi / 2 in three parts, the first two short enough for exact products with the number of quarter turns."""


@kernel
def sine_cosine(angle):
    """(sin, cos) of an angle [rad]; NaN of what is not finite."""
    turns = floor(angle * 0.6366197723675814 + 0.5)
    x = ((angle - turns * PI_2_A) - turns * PI_2_B) - turns * PI_2_C
    z = x * x
    s = z * (1.0 / 355687428096000.0) - 1.0 / 1307674368000.0
    s = s * z + 1.0 / 6227020800.0
    s = s * z - 1.0 / 39916800.0
    s = s * z + 1.0 / 362880.0
    s = s * z - 1.0 / 5040.0
    s = s * z + 1.0 / 120.0
    s = s * z - 1.0 / 6.0
    s = x + x * z * s
    c = z * (1.0 / 20922789888000.0) - 1.0 / 87178291200.0
    c = c * z + 1.0 / 479001600.0
    c = c * z - 1.0 / 3628800.0
    c = c * z + 1.0 / 40320.0
    c = c * z - 1.0 / 720.0
    c = c * z + 1.0 / 24.0
    c = 1.0 - 0.5 * z + z * z * c
    quarter = turns - 4.0 * floor(0.25 * turns)
    odd = (quarter == 1.0) | (quarter == 3.0)
    sine, cosine = select(odd, c, s), select(odd, s, c)
    return (
        select(quarter >= 2.0, -sine, sine),
        select((quarter == 1.0) | (quarter == 2.0), -cosine, cosine),
    )
