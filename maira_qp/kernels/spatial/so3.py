"""The derivatives of a rotation vector phi [rad]: the compiled form of those of `problem.tasks.frame`.

phi is that of R_d R^T, and a turn w of R makes it fall by `J^-1_r w`, `J^-1_r = I + [phi]x / 2 + k [phi]x^2`.
"""

from __future__ import annotations

import math

from maira_qp.kernels.jit.decorators import kernel
from maira_qp.kernels.jit.simd import select, square_root
from maira_qp.kernels.jit.simd_trig import sine_cosine
from maira_qp.kernels.spatial.vectors import cross, dot, length


@kernel
def flattening(square):
    """k for the square of an angle, in one lane or eight; 1/12 at 0."""
    half = 0.5 * square_root(square)
    sine, cosine = sine_cosine(half)
    return select(square < 1e-4, 1.0 / 12.0 + square / 720.0, (1.0 - half * cosine / sine) / square)


@kernel
def flattening_slope(angle):
    """`dk/dangle / angle`; 1/360 at 0."""
    if angle < 0.1:
        return 1.0 / 360.0 + angle * angle / 7560.0
    h = 0.5 * angle
    return (h / math.tan(h) + (h / math.sin(h)) ** 2 - 2.0) / angle**4


@kernel
def inverse_right_jacobian(phi, M):
    """`J^-1_r` into M (3, 3)."""
    x, y, z = phi
    k = flattening(dot(phi, phi))
    M[0, 0], M[0, 1], M[0, 2] = 1.0 - k * (y * y + z * z), k * x * y - 0.5 * z, k * x * z + 0.5 * y
    M[1, 0], M[1, 1], M[1, 2] = k * x * y + 0.5 * z, 1.0 - k * (x * x + z * z), k * y * z - 0.5 * x
    M[2, 0], M[2, 1], M[2, 2] = k * x * z - 0.5 * y, k * y * z + 0.5 * x, 1.0 - k * (x * x + y * y)


@kernel
def bend_of_logarithm(phi, u, M, S):
    """How `u . phi` bends by turns, S (3, 3), symmetric, beside the bend of the turns themselves; M (3, 3) is `J^-1_r`.

    With G the derivative of `J^-T_r u` by phi, S is the symmetric part of `-G J^-1_r`.
    """
    angle = length(phi)
    k, twice = flattening(dot(phi, phi)), cross(phi, cross(phi, u))
    for j in range(3):
        column = M[0, j], M[1, j], M[2, j]
        by_phi, by_u, across = dot(phi, column), dot(u, column), cross(u, column)
        slope = flattening_slope(angle) * by_phi
        for i in range(3):
            S[i, j] = -0.5 * across[i] - slope * twice[i]
            S[i, j] -= k * (dot(phi, u) * column[i] + phi[i] * by_u - 2.0 * u[i] * by_phi)
    for i in range(3):
        for j in range(i):
            S[i, j] = 0.5 * (S[i, j] + S[j, i])
            S[j, i] = S[i, j]


@kernel
def bend_of_even_cost(phi, weight, S):
    """What a turn across phi changes the cost `1/2 |weight phi|^2` less than by itself, as S (3, 3).

    It is `-k weight^2 (|phi|^2 I - phi phi^T)`: the turns' derivatives of the logarithm cancel but for this.
    """
    k = flattening(dot(phi, phi)) * weight * weight
    for i in range(3):
        for j in range(3):
            S[i, j] = k * phi[i] * phi[j] - (k * dot(phi, phi) if i == j else 0.0)
