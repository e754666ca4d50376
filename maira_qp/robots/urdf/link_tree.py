"""The links of a URDF and the joints between them, checked to be one tree."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

from maira_qp.errors import FrameError, RobotError, listed
from maira_qp.robots.model.frame_names import known_frame, named_tips

MAX_DEPTH = 500
"""Longest chain of links that is accepted: Pinocchio recurses along it, and 5,000 links crash it."""
MAX_LINKS = 10_000
"""Most links that are accepted: Pinocchio compares the name of each with all before it."""


TOOL_WORDS = ("tool", "tcp", "end_effector", "ee_link", "eef", "grasp")
"""What is in the names of links that are made to be the tip."""


class Edge(NamedTuple):
    """A joint as an edge from link to link."""

    joint: str
    parent: str
    child: str
    moves: bool
    """It is neither fixed nor of a kind that is not known."""


class LinkTree:
    """The tree of links; raises `RobotError` if links and joints are not one."""

    def __init__(self, links: Iterable[str], edges: Iterable[Edge]) -> None:
        self.links = list(links)
        if len(self.links) > MAX_LINKS:
            raise RobotError(f"the robot has {len(self.links)} links, more than the {MAX_LINKS} that are accepted")
        self.above: dict[str, Edge] = {}
        self._edges: dict[str, Edge] = {}
        self.beneath: dict[str, list[Edge]] = {link: [] for link in self.links}
        for edge in edges:
            self._add(edge)
        roots = [link for link in self.links if link not in self.above]
        if len(roots) > 1:
            raise RobotError(f"the links are not one tree, {len(roots)} have no parent: {', '.join(roots[:10])}")
        reached = {edge.child for edge in self.below(roots[0])} | set(roots) if roots else set()
        stray = [link for link in self.links if link not in reached]
        if stray:
            raise RobotError(f"the joints form a cycle through {', '.join(stray[:10])}")
        self.root = roots[0]

    def rerooted(self, base: str) -> tuple[LinkTree, set[str]]:
        """The same links as a tree whose root is `base`, and the joints that lead the other way in it."""
        turned = {edge.joint for edge in self.path(self.root, base)}
        swapped = [
            edge._replace(parent=edge.child, child=edge.parent) if edge.joint in turned else edge
            for edge in self.above.values()
        ]
        return LinkTree(self.links, swapped), turned

    def _add(self, edge: Edge) -> None:
        for link in (edge.parent, edge.child):
            if link not in self.beneath:
                missing = f"names a link {link!r} that does not exist"
                raise RobotError(f"joint {edge.joint!r} {missing}; {listed(self.links, link)}")
        other = self.above.get(edge.child)
        if other is not None:
            raise RobotError(f"link {edge.child!r} has two parents, by the joints {other.joint!r} and {edge.joint!r}")
        self.above[edge.child] = self._edges[edge.joint] = edge
        self.beneath[edge.parent].append(edge)

    def below(self, base: str, first: Iterable[str] = ()) -> Iterator[Edge]:
        """All edges under a link, depth first, parents before children; at a fork the joints in `first` come first.

        Raises `RobotError` if a chain is longer than `MAX_DEPTH`.
        """
        order = {joint: rank for rank, joint in enumerate(first)}
        stack = [(base, 0)]
        while stack:
            link, depth = stack.pop()
            if depth > MAX_DEPTH:
                raise RobotError(f"a chain is longer than {MAX_DEPTH} links, more than Pinocchio survives")
            if link != base:
                yield self.above[link]
            forks = sorted(self.beneath[link], key=lambda edge: order.get(edge.joint, len(order)))
            stack += [(edge.child, depth + 1) for edge in reversed(forks)]

    def edge(self, joint: str) -> Edge:
        """The edge that is the joint of that name."""
        return self._edges[joint]

    def known(self, link: str, role: str) -> str:
        """The name itself if it is a link's. Raises `FrameError` that names the role, `tip` or `base`."""
        return known_frame(link, role, self.links)

    def known_joint(self, joint: str) -> str:
        """The name itself if it is a joint's. Raises `RobotError`."""
        if joint not in self._edges:
            raise RobotError(f"{joint!r} is not a joint of this robot; {listed(self._edges, joint)}")
        return joint

    def leaves(self, base: str) -> list[str]:
        """The links under the base that carry nothing."""
        return [link for link in [base, *(edge.child for edge in self.below(base))] if not self.beneath[link]]

    def known_tips(self, tip: str | Sequence[str] | None, base: str) -> tuple[str, ...]:
        """The tips as a tuple: one name, a list or tuple of names, or None for the only leaf under the base.

        Raises `FrameError` if a name is not a link's, if names are repeated or none are given, or if None is given
        where there are several leaves.
        """
        if tip is None:
            leaves = self.leaves(base)
            if len(leaves) > 1:
                raise self._choice(base)
            return (leaves[0],)
        return named_tips(tip, self.links, self.leaves(base))

    def _choice(self, base: str) -> FrameError:
        """The error that says which tip to choose: those named as tools first, then those behind most moving joints."""
        depth = {base: 0}
        for edge in self.below(base):
            depth[edge.child] = depth[edge.parent] + edge.moves
        leaves = sorted((link for link in self.leaves(base) if depth[link]), key=lambda link: -depth[link])
        if not leaves:
            return FrameError(f"no joint moves behind {base!r}; {listed(self.leaves(base))}")
        ranks = {
            link: [k for k, word in enumerate(TOOL_WORDS) if word in link.lower()] for link in depth if depth[link]
        }
        tools = sorted((link for link in ranks if ranks[link]), key=lambda link: (-depth[link], ranks[link]))
        first, *others = dict.fromkeys([*tools, *leaves])
        several = [first, *(link for link in others if link in leaves)][:2]
        count, names = f"there are {len(leaves)} tips", listed(leaves)
        error = FrameError(f"{count}, choose one (tip={first!r}) or several (tip={several!r}); {names}")
        error.for_shell = f"{count}, choose one: --tip {first}; {names}"
        return error

    def carries(self, base: str, link: str) -> bool:
        """Whether a link hangs on the base, or is the base."""
        while link != base:
            if link not in self.above:
                return False
            link = self.above[link].parent
        return True

    def path(self, base: str, tip: str) -> list[Edge]:
        """The edges from the base to the tip, which hangs on it."""
        path: list[Edge] = []
        link = tip
        while link != base:
            path.append(self.above[link])
            link = path[-1].parent
        return path[::-1]
