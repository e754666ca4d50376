"""An S-R-S arm at a target: what the swivel angle psi leaves open, as sinusoids of it.

For one of the two elbow angles the rotation A = R_1 R_2 R_3 of the shoulder takes v, the wrist seen from the shoulder,
onto the line from the shoulder to where the wrist has to be, and is free to turn about that line by psi (see
`analytic.srs.geometry`, whose letters and whose psi these are). In a frame that has its first axis along the line and
another that has it along v, A is a rotation about the first axis: for u = (u_0, u_1, u_2) in the one and
w = (w_0, w_1, w_2) in the other

    u . A w = u_0 w_0 + (u_1 w_1 + u_2 w_2) cos psi + (u_2 w_1 - u_1 w_2) sin psi.

The wrist, taken backwards, has R_7^T, R_6^T and R_5^T make B^T = D^T A R_4, three rotations about the axes against
a_7, a_6 and a_5. So both are a spherical joint (`spherical.py`) whose first frame goes with the line, and whose last
goes with v; for the wrist the first is turned by D, the last by R_4.

An arm is one array (3, 80): the elbow, the shoulder and the wrist. The rows of shoulder and wrist are in
`spherical.py`; first frames are in base axes, the wrist's in the axes of the tip, so that the target's rotation turns
them, and last frames in the axes of the elbow at q_4 = 0: x from the shoulder to the elbow, z along its axis.
"""

from __future__ import annotations

import numpy as np

from maira_qp.kernels.jit.decorators import device_kernel, kernel
from maira_qp.kernels.layout import Axis, Elbow, Part, Sinusoid, Spherical
from maira_qp.kernels.srs.spherical_joint import discriminant, is_reached

TRIED = 5
"""So many swivel angles `first_within` tries, a golden section of the circle apart."""
_COS_GOLDEN, _SIN_GOLDEN = np.cos(np.pi * (3 - np.sqrt(5))), np.sin(np.pi * (3 - np.sqrt(5)))
_SMALL = 1e-9


@kernel
def approach(arm, target, base):
    """Distance [m] of shoulder and wrist at a target (12,); both first frames, on the line, into base (2, 9)."""
    x, y, z = arm[Part.ELBOW, Elbow.LEVER], arm[Part.ELBOW, Elbow.LEVER + 1], arm[Part.ELBOW, Elbow.LEVER + 2]
    lx = target[0] * x + target[1] * y + target[2] * z + target[9] - arm[Part.ELBOW, Elbow.CENTRE]
    ly = target[3] * x + target[4] * y + target[5] * z + target[10] - arm[Part.ELBOW, Elbow.CENTRE + 1]
    lz = target[6] * x + target[7] * y + target[8] * z + target[11] - arm[Part.ELBOW, Elbow.CENTRE + 2]
    distance = np.sqrt(lx * lx + ly * ly + lz * lz)
    lx, ly, lz = lx / distance, ly / distance, lz / distance
    nx, ny, nz = _across(
        lx,
        ly,
        lz,
        arm[Part.ELBOW, Elbow.REFERENCE],
        arm[Part.ELBOW, Elbow.REFERENCE + 1],
        arm[Part.ELBOW, Elbow.REFERENCE + 2],
    )
    mx, my, mz = ly * nz - lz * ny, lz * nx - lx * nz, lx * ny - ly * nx
    for i in range(3):
        k = Spherical.FIRST_FRAME + 3 * i
        x, y, z = arm[Part.SHOULDER, k], arm[Part.SHOULDER, k + 1], arm[Part.SHOULDER, k + 2]
        base[0, 3 * i] = lx * x + ly * y + lz * z
        base[0, 3 * i + 1] = nx * x + ny * y + nz * z
        base[0, 3 * i + 2] = mx * x + my * y + mz * z
        u, v, w = arm[Part.WRIST, k], arm[Part.WRIST, k + 1], arm[Part.WRIST, k + 2]
        x = target[0] * u + target[1] * v + target[2] * w
        y = target[3] * u + target[4] * v + target[5] * w
        z = target[6] * u + target[7] * v + target[8] * w
        base[1, 3 * i] = lx * x + ly * y + lz * z
        base[1, 3 * i + 1] = nx * x + ny * y + nz * z
        base[1, 3 * i + 2] = mx * x + my * y + mz * z
    return distance


@device_kernel
def _across(lx, ly, lz, x, y, z):
    """The unit vector across a line that is nearest to (x, y, z); where that is along it, the one that `srs` takes."""
    along = lx * x + ly * y + lz * z
    x, y, z = x - along * lx, y - along * ly, z - along * lz
    if x * x + y * y + z * z < _SMALL * _SMALL:
        least = min(abs(lx), abs(ly), abs(lz))
        if abs(lx) == least:
            x, y, z = 0.0, lz, -ly
        elif abs(ly) == least:
            x, y, z = -lz, 0.0, lx
        else:
            x, y, z = ly, -lx, 0.0
    length = np.sqrt(x * x + y * y + z * z)
    x, y, z = x / length, y / length, z / length
    along = lx * x + ly * y + lz * z  # once more: the first difference may have cancelled
    x, y, z = x - along * lx, y - along * ly, z - along * lz
    length = np.sqrt(x * x + y * y + z * z)
    return x / length, y / length, z / length


@kernel
def bend(arm, distance):
    """Cosine and sine of theta = |q_4 - phi|, which puts the wrist at this distance [m] within the annulus."""
    smallest, largest = arm[Part.ELBOW, Elbow.SMALLEST], arm[Part.ELBOW, Elbow.LARGEST]
    short = max((largest - distance) * (largest + distance), 0.0)
    long = max((distance - smallest) * (distance + smallest), 0.0)
    return (long - short) / (long + short), 2.0 * np.sqrt(short * long) / (long + short)


@kernel
def elbow_from_middle(arm, cosine, sine, sign):
    """Cosine and sine of q_4 less the middle of its range, for theta as of `bend` on the side of `sign`."""
    a, b = arm[Part.ELBOW, Elbow.COS_FROM_MIDDLE], arm[Part.ELBOW, Elbow.SIN_FROM_MIDDLE]
    return a * cosine - sign * b * sine, b * cosine + sign * a * sine


@kernel
def swing(arm, base, cosine, sine, sign, circles):
    """The sinusoids of shoulder and wrist for an elbow, see `bend`, into circles (2, 15): z, p, r, p', r' of each.

    Returns whether psi is well defined: the wrist is not on the elbow's axis as seen from the shoulder.
    """
    a, b = arm[Part.ELBOW, Elbow.COS_PHASE], arm[Part.ELBOW, Elbow.SIN_PHASE]
    c, s = a * cosine - sign * b * sine, b * cosine + sign * a * sine
    gx, gy, vz = arm[Part.ELBOW, Elbow.FOREARM], arm[Part.ELBOW, Elbow.FOREARM + 1], arm[Part.ELBOW, Elbow.FOREARM + 2]
    vx, vy = arm[Part.ELBOW, Elbow.UPPER_ARM] + c * gx - s * gy, s * gx + c * gy
    flat = np.sqrt(vx * vx + vy * vy)
    length = np.sqrt(flat * flat + vz * vz)
    x, y = vx / flat, vy / flat  # v = (along x, along y, up), and two directions across it
    along, up = flat / length, vz / length
    for part in range(2):
        for i in range(3):
            k = Spherical.LAST_FRAME + 3 * i
            wx, wy, w = arm[Part.SHOULDER + part, k], arm[Part.SHOULDER + part, k + 1], arm[Part.SHOULDER + part, k + 2]
            if part == 1:
                wx, wy = c * wx - s * wy, s * wx + c * wy
            radial = x * wx + y * wy
            w0, w1, w2 = along * radial + up * w, sign * (y * wx - x * wy), sign * (up * radial - along * w)
            _sinusoid(base, part, 0, w0, w1, w2, circles, Sinusoid.P_LAST + 3 * (i - 1) if i > 0 else Sinusoid.Z)
            if i == 0:
                _sinusoid(base, part, 3, w0, w1, w2, circles, Sinusoid.P)
                _sinusoid(base, part, 6, w0, w1, w2, circles, Sinusoid.R)
    return flat > _SMALL * arm[Part.ELBOW, Elbow.LENGTH]


@device_kernel
def _sinusoid(base, part, k, w0, w1, w2, circles, at):
    """u . A w for u, which stands in `base` from k on."""
    u0, u1, u2 = base[part, k], base[part, k + 1], base[part, k + 2]
    circles[part, at] = u0 * w0
    circles[part, at + 1] = u1 * w1 + u2 * w2
    circles[part, at + 2] = u2 * w1 - u1 * w2


@kernel
def value_at(circles, part, k, c, s):
    """One of the sinusoids at psi with cosine c and sine s."""
    return circles[part, k] + circles[part, k + 1] * c + circles[part, k + 2] * s


@kernel
def values_at(circles, part, c, s):
    """z, p, r, p', r' of the shoulder (part 0) or the wrist (part 1) at psi with cosine c and sine s."""
    return (
        value_at(circles, part, Sinusoid.Z, c, s),
        value_at(circles, part, Sinusoid.P, c, s),
        value_at(circles, part, Sinusoid.R, c, s),
        value_at(circles, part, Sinusoid.P_LAST, c, s),
        value_at(circles, part, Sinusoid.R_LAST, c, s),
    )


@kernel
def branch_at(arm, circles, part, c, s):
    """The branch, +1 or -1, on which shoulder or wrist are within the limits at psi; 0 without one."""
    joint = arm[Part.SHOULDER + part]
    z, p, r, p_last, r_last = values_at(circles, part, c, s)
    square = discriminant(joint, Axis.FIRST, z, p, r)
    if square < 0.0:
        return 0.0
    if is_reached(joint, z, p, r, p_last, r_last, square, 1.0):
        return 1.0
    return -1.0 if is_reached(joint, z, p, r, p_last, r_last, square, -1.0) else 0.0


@kernel
def first_within(arm, circles, c, s):
    """Cosine and sine of a swivel angle at which shoulder and wrist are within their limits, and whether there is one.

    A few are tried, the first of them with cosine c and sine s.
    """
    for _ in range(TRIED):
        if branch_at(arm, circles, 0, c, s) != 0.0 and branch_at(arm, circles, 1, c, s) != 0.0:
            return c, s, True
        c, s = c * _COS_GOLDEN - s * _SIN_GOLDEN, s * _COS_GOLDEN + c * _SIN_GOLDEN
    return c, s, False
