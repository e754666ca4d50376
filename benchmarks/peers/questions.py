"""The questions of the race, the same for all: anywhere, nearby, and out of reach."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from peers.arms import Arm

NEARBY = 0.1
"""How far a nearby target is from its start [rad], as a norm of all joints."""
BEYOND = 1.1
"""How far away a target out of reach is, in reaches."""


@dataclass(frozen=True)
class Questions:
    """Targets (N, 4, 4) and starts (N, n) for them."""

    targets: np.ndarray
    starts: np.ndarray


def anywhere(arm: Arm, count: int, rng: np.random.Generator) -> Questions:
    """Poses of configurations uniform within the limits, and random starts."""
    return Questions(_poses(arm, arm.configurations(count, rng)), arm.configurations(count, rng))


def nearby(arm: Arm, count: int, rng: np.random.Generator) -> Questions:
    """Random starts, and the poses of configurations that are `NEARBY` of them, in any direction, within the limits."""
    starts = arm.configurations(count, rng)
    direction = rng.standard_normal(starts.shape)
    moved = starts + NEARBY * direction / np.linalg.norm(direction, axis=1, keepdims=True)
    return Questions(_poses(arm, np.clip(moved, arm.lower, arm.upper)), starts)


def out_of_reach(arm: Arm, count: int, rng: np.random.Generator) -> Questions:
    """Orientations of random configurations at positions that no configuration comes near, and random starts."""
    asked = anywhere(arm, count, rng)
    centre, reach = arm.judge.reach()
    outward = rng.standard_normal((count, 3))
    asked.targets[:, :3, 3] = centre + BEYOND * reach * outward / np.linalg.norm(outward, axis=1, keepdims=True)
    return asked


def _poses(arm: Arm, q: np.ndarray) -> np.ndarray:
    return np.array([arm.judge.forward(row) for row in q])
