"""Who takes part on an arm: ours, and the peers that are installed and provably mean the same arm."""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec

import numpy as np

from maira_qp.evaluation.contestant import Contestant
from peers.arms import Arm
from peers.ours import one_at_a_time

SAME_POSE, SAME_LIMIT = 1e-9, 1e-6
"""How far [m, and entries of the rotation] a peer's forward kinematics, [rad] its limits, may be from the judge's."""
PEERS = {
    "Robotics Toolbox": ("roboticstoolbox", "roboticstoolbox-python", "peers.compiled", "robotics_toolbox"),
    "EAIK": ("eaik", "eaik", "peers.closed_form", "eaik"),
    "ssik": ("ssik", "ssik[urdf]", "peers.closed_form", "ssik"),
    "OptIK": ("optik", "optik-py", "peers.compiled", "optik"),
    "TRAC-IK": ("pytracik", "pytracik", "peers.compiled", "trac_ik"),
    "cartan": ("cartan", "cartan-bindings", "peers.compiled", "cartan"),
    "dynibo": ("dynibo", "dynibo", "peers.compiled", "dynibo"),
    "Pink": ("pink", "pin-pink", "peers.qp_steps", "pink"),
    "Mink": ("mink", "mink", "peers.qp_steps", "mink"),
}
"""For each peer: what it is imported as, what pip calls it, and the module and function that set it up for an arm."""


def line_up(arm: Arm) -> tuple[list[Contestant], list[str]]:
    """Those who race on an arm, see `admit`."""
    return admit(arm, one_at_a_time(arm), PEERS)


def admit(
    arm: Arm, ours: list[Contestant], peers: dict[str, tuple[str, str, str, str]]
) -> tuple[list[Contestant], list[str]]:
    """Ours and the peers that are installed and mean the same arm, and a line of text about each that is missing.

    Peers are given as in `PEERS`. Raises `RuntimeError` if ours mean another arm than the judge.
    """
    taking_part, remarks = list(ours), []
    for contestant in taking_part:
        if objection := disagreement(contestant, arm):
            raise RuntimeError(f"{contestant.name}: {objection}")
    for name, (imported, package, module, function) in peers.items():
        if find_spec(imported) is None:
            remarks.append(f"{name}: skipped, not installed (pip install '{package}')")
            continue
        try:
            contestant = getattr(import_module(module), function)(arm)
            objection = disagreement(contestant, arm)
        except Exception as reason:  # whatever a peer may throw, the others go on
            remarks.append(f"{name}: cannot do this arm: {type(reason).__name__}: {reason}")
            continue
        if objection:
            remarks.append(f"{name}: refused, {objection}")
        else:
            taking_part.append(contestant)
    return taking_part, remarks


def disagreement(contestant: Contestant, arm: Arm, count: int = 20) -> str:
    """In what a contestant's arm differs from the judge's, at so many random configurations; empty if in nothing."""
    assert contestant.forward is not None
    q = arm.configurations(count, np.random.default_rng(0))
    off = max(float(np.abs(contestant.forward(row) - arm.judge.forward(row)).max()) for row in q)
    if not off <= SAME_POSE:
        return f"its forward kinematics is off by {off:.1e}"
    if contestant.limits is not None:
        gap = max(
            np.abs(np.asarray(a) - b).max() for a, b in zip(contestant.limits, (arm.lower, arm.upper), strict=True)
        )
        if not gap <= SAME_LIMIT:
            return f"its joint limits are off by {gap:.1e}"
    return ""
