"""The links of a robot's description that may be its tip."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

from maira_qp.robots.urdf.link_tree import TOOL_WORDS


def tips_in(file: Path) -> tuple[str, ...]:
    """The links of a URDF file that joints move; none of what cannot be read.

    Those first that are named as tools, then the ends; of alike ones those behind most joints.
    """
    try:
        root = ElementTree.parse(file).getroot()
    except (ElementTree.ParseError, OSError, ValueError):
        return ()
    parents: dict[str, tuple[str, bool]] = {}
    for joint in root.iter("joint"):
        parent, child = joint.find("parent"), joint.find("child")
        if parent is not None and child is not None:
            moves = joint.get("type") != "fixed"
            parents[child.get("link", "")] = parent.get("link", ""), moves
    carrying = {parent for parent, _ in parents.values()}
    depths = {link: _depth(link, parents) for link in parents}

    def rank(link: str) -> tuple[bool, bool, int]:
        return not any(word in link.lower() for word in TOOL_WORDS), link in carrying, -depths[link]

    return tuple(sorted((link for link in depths if depths[link]), key=rank))


def _depth(link: str, parents: dict[str, tuple[str, bool]]) -> int:
    """Moving joints between the root and a link."""
    depth = 0
    for _ in parents:  # no longer than this, were there a cycle
        if link not in parents:
            break
        link, moves = parents[link]
        depth += moves
    return depth
