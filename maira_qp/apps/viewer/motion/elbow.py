"""Where the elbow is on the curve of configurations that it can take while the tool stands still.

Of an S-R-S arm the curve is an arc of solutions, in closed form; of another redundant arm it is walked numerically.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from maira_qp.analytic.srs.arcs import Arc, arcs
from maira_qp.analytic.srs.geometry import BRANCHES, SRS, Branch, rotations, wrapped
from maira_qp.apps.viewer.motion.self_motion import SelfMotion, is_redundant, self_motion
from maira_qp.robots.model.robot import Robot

ON_ARC = 1e-6
"""How near a configuration is to the arc that it is on, in every joint [rad]."""


class Elbow(NamedTuple):
    """A place on a curve."""

    curve: Arc | SelfMotion
    psi: float
    """Swivel angle [rad], or way along the self-motion [rad, or m], from `curve.lower` to `curve.upper`"""


def elbow_finder(robot: Robot) -> Callable[[np.ndarray], Elbow | None] | None:
    """Finds where the elbow is at a configuration (n,), for any thread; None: the arm is not redundant."""
    srs = SRS.of(robot)
    if srs is not None:
        return partial(elbow_of, srs)
    return partial(_at_start, robot) if is_redundant(robot) else None


def elbow_of(srs: SRS, q: np.ndarray) -> Elbow | None:
    """The arc that q (7,) is on, and where; None where there is none, as at the exact singularities."""
    T = srs.robot.forward(q).homogeneous
    found = _branch_of(srs, T, q)
    if found is None:
        return None
    branch, angle = found
    nearest, least = None, ON_ARC
    for arc in arcs(srs, T):
        psi = _on(arc, angle)
        if arc.branch == branch and abs(np.sin(0.5 * (psi - angle))) < ON_ARC:
            away = float(np.abs(arc.at(np.array(psi)) - q).max())
            if away < least:
                nearest, least = Elbow(arc, psi), away
    return nearest


def _at_start(robot: Robot, q: np.ndarray) -> Elbow | None:
    """On the self-motion that begins at q (n,)."""
    curve = self_motion(robot, q)
    return None if curve is None else Elbow(curve, 0.0)


def _branch_of(srs: SRS, T: np.ndarray, q: np.ndarray) -> tuple[Branch, float] | None:
    """The branch that q (7,) is on, and its swivel angle [rad], T (4, 4) being where its tip is."""
    A = rotations(srs.axes[0], q[0]) @ rotations(srs.axes[1], q[1]) @ rotations(srs.axes[2], q[2])
    for elbow in srs.elbow_branches(T):
        # the cosine and sine parts of A(psi) have the same norm, and are at right angles to each other and to the rest
        psi = float(np.arctan2((A * elbow.shoulder.sine).sum(), (A * elbow.shoulder.cosine).sum()))
        branches = [branch for branch in BRANCHES if branch.elbow == elbow.sign]
        for branch, found in zip(branches, srs.evaluate(elbow, np.array([psi]))[0], strict=True):
            if np.abs(wrapped(found - q)).max() < ON_ARC:
                return branch, psi
    return None


def _on(arc: Arc, angle: float) -> float:
    """The angle [rad] on an arc that is a swivel angle, or the nearer end."""
    psi = float(arc.lower + np.mod(angle - arc.lower, 2 * np.pi))
    return psi if psi <= arc.upper else min((arc.lower, arc.upper), key=lambda end: abs(np.sin(0.5 * (angle - end))))
