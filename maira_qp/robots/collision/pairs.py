"""Which pairs of shapes are looked at: not those that cannot help touching."""

from __future__ import annotations

import logging
import os
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from maira_qp.arrays import is_listing
from maira_qp.errors import OptionError, listed, shown
from maira_qp.robots.collision.scene import Part, Scene
from maira_qp.robots.model.robot import Robot
from maira_qp.robots.srdf.reader import read_srdf

log = logging.getLogger(__name__)

SAMPLES = 1000
"""Random configurations for `always_near`."""
NEARLY_ALL = 0.95
"""Share of them in which two links that always touch are near each other."""

NamePair = frozenset[str]


def movable_pairs(robot: Robot, parts: Sequence[Part], own: int, self_collision: bool) -> list[tuple[int, int]]:
    """Pairs of parts, of which the first `own` are the robot's and the others obstacles.

    Left out are parts that cannot move against each other, and links joined by a joint, where links that are fixed to
    each other count as one.
    """
    parents = robot.model.parents
    pairs: list[tuple[int, int]] = []
    for j, second in enumerate(parts):
        for i, first in enumerate(parts[: min(j, own)]):
            a, b = first.joint, second.joint
            if j >= own:
                if a != 0:
                    pairs.append((i, j))
            elif self_collision and a != b and parents[a] != b and parents[b] != a:
                pairs.append((i, j))
    return pairs


def without(pairs: Iterable[tuple[int, int]], parts: Sequence[Part], allowed: set[NamePair]) -> list[tuple[int, int]]:
    """The pairs that are not allowed to touch, by the names of their parts."""
    return [(i, j) for i, j in pairs if frozenset((parts[i].name, parts[j].name)) not in allowed]


def always_near(scene: Scene, own: int, margin: float) -> set[NamePair]:
    """The pairs of links nearer than `margin` [m] in nearly all of some random configurations, always the same ones.

    Two shapes of neighbouring links that overlap by design are such a pair. Pairs that are near in none of them are
    not told apart: that is no proof that they never meet, and `coal` is quick to see that they are far apart.
    """
    rng = np.random.default_rng(0)
    names = [frozenset((scene.parts[i].name, scene.parts[j].name)) for i, j in scene.pairs]
    names_of_links = {part.name for part in scene.parts[:own]}
    counts: dict[NamePair, int] = {}
    for _ in range(SAMPLES):
        near = scene.contacts(scene.robot.random_configuration(rng), margin).pairs
        for pair in {names[index] for index in near}:
            counts[pair] = counts.get(pair, 0) + 1
    return {pair for pair, count in counts.items() if count >= NEARLY_ALL * SAMPLES and pair <= names_of_links}


def srdf_pairs(source: str | os.PathLike[str], links: Sequence[str]) -> set[NamePair]:
    """The pairs of an SRDF that may touch; links of other robots do not matter. Raises `RobotError`."""
    pairs = set(read_srdf(source).touching)
    if not any(pair <= set(links) for pair in pairs):
        log.warning("the SRDF allows no pair of links of this robot to touch")
    return pairs


def named_pairs(allowed: Any, names: Sequence[str]) -> set[NamePair]:
    """Pairs of names as sets. Raises `OptionError`."""
    wanted = 'allowed must be "adjacent", "sampled", the path of an SRDF file, or a sequence of pairs of names'
    if not is_listing(allowed):
        raise OptionError(f"{wanted}, not {shown(allowed)}")
    pairs: set[NamePair] = set()
    for pair in allowed:
        if not is_listing(pair) or len(pair := tuple(pair)) != 2:
            raise OptionError(f"{wanted}; this is not a pair of names: {shown(pair)}")
        for name in pair:
            if not isinstance(name, str) or name not in names:
                raise OptionError(f"allowed: {shown(name)} is not a link or an obstacle; {listed(names, name)}")
        pairs.add(frozenset(pair))
    return pairs
