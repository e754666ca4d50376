"""The objectives that are a posture, `1/2 sum_i w_i (q_i - ref_i)^2`: `Posture` and `LimitDistance`, compiled."""

from __future__ import annotations

from maira_qp.kernels.jit.decorators import kernel
from maira_qp.kernels.jit.simd import broadcast, load


@kernel
def objective_cost(q, reference, weights):
    """The value at q (n,)."""
    s = broadcast(q, 0.0)
    for i in range(len(q)):
        d = load(q, i) - reference[i]
        s = s + weights[i] * d * d
    return 0.5 * s
