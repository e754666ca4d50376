"""Where the elbow of an S-R-S arm is on the arc of solutions that its configuration belongs to."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from maira_qp.robots.arcs import Arc, arcs
from maira_qp.robots.srs import SRS, rotations

ON_ARC = 1e-6
"""How near a configuration is to the arc that it is on, in every joint [rad]."""


class Elbow(NamedTuple):
    """A place on an arc."""

    arc: Arc
    psi: float
    """Swivel angle [rad], from `arc.lower` to `arc.upper`"""


def elbow_of(srs: SRS, q: np.ndarray) -> Elbow | None:
    """The arc that q (7,) is on, and where; None where there is none, as at the exact singularities."""
    T = srs.robot.forward(q).homogeneous
    A = rotations(srs.axes[0], q[0]) @ rotations(srs.axes[1], q[1]) @ rotations(srs.axes[2], q[2])
    # the cosine and sine parts of A(psi) have the same norm, and are at right angles to each other and to the rest
    angles = {
        branch.sign: float(np.arctan2((A * branch.shoulder.sine).sum(), (A * branch.shoulder.cosine).sum()))
        for branch in srs.elbow_branches(T)
    }
    nearest, least = None, ON_ARC
    for arc in arcs(srs, T):
        psi = arc.lower + np.mod(angles[arc.branch.elbow] - arc.lower, 2 * np.pi)
        psi = (
            float(psi)
            if psi <= arc.upper
            else min(arc.lower, arc.upper, key=lambda end: abs(np.sin(0.5 * (psi - end))))
        )
        away = float(np.abs(arc.at(np.array(psi)) - q).max())
        if away < least:
            nearest, least = Elbow(arc, psi), away
    return nearest
