"""The order of q at the forks of a tree: leaders of mimic joints before their followers, then tips as they are given.

Pinocchio visits a tree depth first and needs the leader of a mimic joint before the joint itself. So at the fork where
the ways to the two part, the branch of the leader comes first.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from maira_qp.errors import RobotError
from maira_qp.robots.urdf.joint import Joint
from maira_qp.robots.urdf.link_tree import LinkTree


def visiting_order(tree: LinkTree, moving: Mapping[str, Joint], path: list[str], base: str) -> list[str]:
    """Joints by the order in which to follow them at a fork: `path`, those on the way to a tip, the first tip's first.

    `moving` are the joints that move, by name. Among the joints are those that lead to the leaders of mimic joints
    beside the path. Raises `RobotError` if a leader cannot come before its follower: it stands before the base, its
    follower carries it, or two branches hold leaders of each other.
    """
    child_of = {edge.joint: edge.child for edge in tree.below(base)}
    earlier: dict[str, list[str]] = {}
    aside: list[str] = []
    for joint in moving.values():
        if joint.mimic is None:
            continue
        leader = joint.mimic[0]
        if leader not in child_of:
            raise RobotError(f"joint {leader!r} leads a mimic joint between base and tip, but stands before the base")
        ways = [[edge.joint for edge in tree.path(base, child_of[name])] for name in (leader, joint.name)]
        fork = next((pair for pair in zip(*ways, strict=False) if pair[0] != pair[1]), None)
        if fork is not None:
            earlier.setdefault(fork[1], []).append(fork[0])
            aside += [name for name in ways[0] if name not in path]
        elif len(ways[0]) > len(ways[1]):
            raise RobotError(_swap(joint))
    return _sorted([*path, *aside], earlier)


def _swap(follower: Joint) -> str:
    """What to do about a joint that carries its leader."""
    leader, multiplier, offset = follower.mimic  # type: ignore[misc]
    swap = f"let {leader!r} mimic {follower.name!r} (multiplier {1 / multiplier!r}, offset {-offset / multiplier!r})"
    return f"joint {follower.name!r} mimics {leader!r}, which it carries: {swap}"


def _sorted(names: Iterable[str], earlier: Mapping[str, list[str]]) -> list[str]:
    """The names in their order, but each only after those that must come earlier. Raises `RobotError` on a circle."""
    done: dict[str, None] = {}

    def visit(name: str, waiting: tuple[str, ...]) -> None:
        if name in waiting:
            branches = " and ".join(repr(each) for each in waiting[waiting.index(name) :])
            raise RobotError(f"the branches behind the joints {branches} mimic each other: let one of them lead")
        if name not in done:
            for before in earlier.get(name, ()):
                visit(before, (*waiting, name))
            done[name] = None

    for name in names:
        visit(name, ())
    return list(done)
