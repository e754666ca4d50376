"""Local methods: from one pose to the next, without a look ahead; from a free start, from their own first solution."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from peers import closed_form, qp_steps
from peers.arms import Arm

from maira_qp.evaluation.contestant import Contestant
from paths.judging import Criterion

TICKS = 4
"""Control ticks a pose."""


def greedy(contestant: Contestant) -> Contestant:
    """A solve for each pose from the answer for the one before."""
    solve = contestant.solve
    assert solve is not None

    def follow(targets: list, q: np.ndarray | None) -> np.ndarray | None:
        found = []
        for target in targets:
            answer = contestant.answer(solve(target, q))
            if not answer.claimed:
                break
            q = answer.q
            found.append(q)
        return np.array(found) if found else None

    return _local(contestant, "greedy", "solve from the configuration before", follow)


def stepwise(contestant: Contestant, arm: Arm) -> Contestant:
    """Control ticks for each pose, in which the slowest joint can just make the largest step that counts."""
    solve, step = contestant.solve, contestant.step
    assert solve is not None
    assert step is not None
    dt = Criterion().step / (TICKS * float(arm.judge.speed.min()))
    middle = 0.5 * (arm.lower + arm.upper)

    def follow(targets: list, q: np.ndarray | None) -> np.ndarray | None:
        if q is None:
            first = contestant.answer(solve(targets[0], None if contestant.draws_starts else middle))
            if not first.claimed:
                return None
            q = first.q
        found = []
        for target in targets:
            for _ in range(TICKS):
                q = np.clip(q + step(q, target, dt) * dt, arm.lower, arm.upper)
            found.append(q)
        return np.array(found)

    return _local(contestant, "step", f"{TICKS} ticks a pose, of {1e3 * dt:.0f} ms", follow)


def _local(contestant: Contestant, method: str, settings: str, follow: Callable[..., Any]) -> Contestant:
    library = contestant.name.partition(" ")[0]
    return replace(
        contestant,
        name=f"{library} {method}",
        settings=settings,
        native=lambda poses: [contestant.native(T) for T in poses],
        follow=follow,
    )


def pink(arm: Arm) -> Contestant:
    """Ticks of Pink, within limits of positions and speeds."""
    return stepwise(qp_steps.pink(arm), arm)


def mink(arm: Arm) -> Contestant:
    """Ticks of Mink, likewise."""
    return stepwise(qp_steps.mink(arm), arm)


def ssik(arm: Arm) -> Contestant:
    """The solve of the module that `ssik build` writes for the arm: of all its answers the one nearest to the last."""
    return greedy(closed_form.ssik(arm))
