"""What is said of a robot beside its kinematics: groups of joints, named configurations, links that may touch."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from maira_qp.errors import ConfigurationError, FrameError, RobotError, listed, shown
from maira_qp.robots.urdf.link_tree import LinkTree


@dataclass(frozen=True)
class Group:
    """A named part of a robot: the joints of its chains, those that are named, those above its links, its subgroups."""

    chains: tuple[tuple[str, str], ...] = ()
    """Base and tip of each."""
    joints: tuple[str, ...] = ()
    links: tuple[str, ...] = ()
    subgroups: tuple[str, ...] = ()


@dataclass(frozen=True)
class Semantics:
    """Groups and named configurations by name, and pairs of links that may touch."""

    groups: Mapping[str, Group] = field(default_factory=dict)
    states: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """Joint values [rad, or m] by `<group>/<name>` or, where they belong to no group, by `<name>`."""
    touching: frozenset[frozenset[str]] = frozenset()
    """Pairs of links between which collisions are not looked for."""

    def joined(self, other: Semantics) -> Semantics:
        """Both; where a name is in both, it is the other's."""
        groups, states = {**self.groups, **other.groups}, {**self.states, **other.states}
        return Semantics(groups, states, self.touching | other.touching)

    def state_names(self, joints: Iterable[str]) -> tuple[str, ...]:
        """Names of the states that say something about at least one of the joints, without their groups."""
        known = set(joints)
        return tuple(dict.fromkeys(_short(name) for name, values in self.states.items() if known & set(values)))

    def state(self, name: str, joints: Sequence[str]) -> dict[str, float]:
        """The values [rad, or m] of those joints that a state names, `<name>` of all groups or `<group>/<name>`.

        Raises `ConfigurationError` for a name that there is not, and where groups contradict each other.
        """
        wanted = {joint: dict[float, str]() for joint in joints}
        for key, values in self.states.items():
            if isinstance(name, str) and name in (key, _short(key)):
                for joint in set(values) & set(wanted):
                    wanted[joint].setdefault(values[joint], key)
        found = {joint: values for joint, values in wanted.items() if values}
        if not found:
            known = self.state_names(joints)
            there = listed(known, name) if known else "its description names none"
            raise ConfigurationError(f"the robot has no state {shown(name)}; {there}")
        for joint, values in found.items():
            if len(values) > 1:
                keys = ", ".join(sorted(values.values()))
                raise ConfigurationError(f"the state {name!r} has several values for {joint!r}; name one of {keys}")
        return {joint: next(iter(values)) for joint, values in found.items()}

    def ends(self, group: str, tree: LinkTree) -> tuple[str, tuple[str, ...]]:
        """The base and the tips of a group in a tree of links.

        Raises `FrameError` for a name that there is not; `RobotError` for a group that is no part of the tree, or in
        which nothing moves.
        """
        if not isinstance(group, str) or group not in self.groups:
            there = listed(self.groups, group) if self.groups else "the description names none; srdf=... may"
            raise FrameError(f"the robot has no group {shown(group)}; {there}")
        only = self.groups[group]
        if len(only.chains) == 1 and only == Group(chains=only.chains):
            base, tip = only.chains[0]
            return tree.known(base, "base"), (tree.known(tip, "tip"),)
        edges = [tree.edge(joint) for joint in self._joints(group, tree, ())]
        children, parents = {edge.child: edge for edge in edges}, {edge.parent for edge in edges}
        tops = [edge.parent for edge in edges if edge.parent not in children]
        if not tops:
            raise RobotError(f"the group {group!r} has no joints")
        base = tops[0]
        while not all(tree.carries(base, top) for top in tops):
            base = tree.above[base].parent
        tips = [tip for tip in children if tip not in parents and any(e.moves for e in tree.path(base, tip))]
        if not tips:
            raise RobotError(f"no joint of the group {group!r} moves")
        return base, tuple(tips)

    def _joints(self, group: str, tree: LinkTree, outer: tuple[str, ...]) -> list[str]:
        """The joints of a group, in the order in which they are named. Raises `RobotError`, `FrameError`."""
        if group not in self.groups or group in outer:
            wrong = "holds itself" if group in outer else "is not there"
            raise RobotError(f"the group {group!r}, a subgroup of {outer[-1]!r}, {wrong}")
        part, found = self.groups[group], list[str]()
        for base, tip in part.chains:
            if not tree.carries(tree.known(base, "base"), tree.known(tip, "tip")):
                raise RobotError(f"the chain of the group {group!r}: {base!r} does not carry {tip!r}")
            found += [edge.joint for edge in tree.path(base, tip)]
        found += [tree.known_joint(joint) for joint in part.joints]
        found += [tree.above[link].joint for link in part.links if tree.known(link, "link") in tree.above]
        for each in part.subgroups:
            found += self._joints(each, tree, (*outer, group))
        return list(dict.fromkeys(found))


def _short(name: str) -> str:
    """The name of a state without its group."""
    return name.rpartition("/")[2]
