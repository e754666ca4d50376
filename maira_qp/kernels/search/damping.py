"""Levenberg and Marquardt's damping and step, of one descent or eight: see `solvers.reference.levenberg_marquardt`.

    mu = factor * damping * |W e|^2 + max(factor, 1) * least damping * the largest entry of H

A step that lowers the cost shrinks the factor, any other raises it.
"""

from __future__ import annotations

from maira_qp.kernels.jit.decorators import device_kernel
from maira_qp.kernels.jit.simd import load, maximum, minimum, select, store, store2
from maira_qp.kernels.layout import Joint, Setting


@device_kernel
def damp(settings, factor, cost, largest, diagonal, H):
    """Make `diagonal` (n,) + mu the diagonal of H (n, n), with the cost `1/2 |W e|^2` and the `largest` entry of H."""
    mu = factor * settings[Setting.DAMPING] * 2.0 * cost
    mu = mu + maximum(factor, 1.0) * settings[Setting.LEAST_DAMPING] * largest
    for i in range(len(diagonal)):
        store2(H, i, i, load(diagonal, i) + mu)


@device_kernel
def next_factor(settings, factor, accepted):
    """The factor after a step that is `accepted`, or is not; above MOST_FACTOR a descent ends."""
    shrunk = maximum(factor * settings[Setting.ACCEPTED], settings[Setting.LEAST_FACTOR])
    return select(accepted, shrunk, factor * settings[Setting.REFUSED])


@device_kernel
def bound_step(chain, settings, q, lower, upper):
    """The box (n,) of a step from q (n,): within the limits, and no longer than LONGEST."""
    for i in range(len(q)):
        store(lower, i, maximum(chain[i, Joint.LOWER] - load(q, i), -settings[Setting.LONGEST]))
        store(upper, i, minimum(chain[i, Joint.UPPER] - load(q, i), settings[Setting.LONGEST]))


@device_kernel
def take_step(chain, q, dq, steps, trial):
    """q + dq, inside the limits to the bit, into trial (n,) where the mask `steps` says so, else q: a mask of moves."""
    moved = load(q, 0) < load(q, 0)  # nowhere
    for i in range(len(q)):
        now = load(q, i)
        there = minimum(maximum(now + load(dq, i), chain[i, Joint.LOWER]), chain[i, Joint.UPPER])
        there = select(steps, there, now)
        moved = moved | (there != now)
        store(trial, i, there)
    return moved
