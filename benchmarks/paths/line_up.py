"""Who follows paths on an arm: ours, and the peers that are installed and provably mean the same arm."""

from __future__ import annotations

from peers.arms import Arm
from peers.line_up import admit

from maira_qp.evaluation.contestant import Contestant
from paths.judging import Criterion
from paths.ours import followers

PEERS = {
    "Pink": ("pink", "pin-pink", "paths.local", "pink"),
    "Mink": ("mink", "mink", "paths.local", "mink"),
    "ssik greedy": ("ssik", "ssik[urdf]", "paths.local", "ssik"),
    "ssik solve_path": ("ssik", "ssik[urdf]", "paths.with_ssik", "solve_path"),
    "ssik tracker": ("ssik", "ssik[urdf]", "paths.with_ssik", "tracker"),
    "roboplan": ("roboplan", "roboplan", "paths.with_roboplan", "planner"),
}
"""As `peers.line_up.PEERS`."""


def line_up(arm: Arm, criterion: Criterion) -> tuple[list[Contestant], list[str]]:
    """Contestants, ours first, and a line of text about each peer that takes no part."""
    return admit(arm, followers(arm, criterion), PEERS)
