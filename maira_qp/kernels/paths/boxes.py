"""Which boxes of configurations a step leads to: the inner loop of `solvers.paths.impossibility`."""

from __future__ import annotations

from maira_qp.kernels.jit.decorators import kernel


@kernel
def within_a_step(before, here, step, found):
    """Whether some point of the boxes before (M, 2, n) is within a step (n,) of boxes (K, 2, n), into `found` (K,)."""
    first = 0
    for k in range(len(here)):
        found[k] = False
        for m in range(len(before)):
            other = (first + m) % len(before)  # neighbours lead to neighbours
            near = True
            for i in range(len(step)):
                if before[other, 0, i] - here[k, 1, i] > step[i] or here[k, 0, i] - before[other, 1, i] > step[i]:
                    near = False
                    break
            if near:
                found[k], first = True, other
                break
