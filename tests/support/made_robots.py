"""Robots made for tests: at random from any joints and axes, and on slides."""

from math import pi

import numpy as np

import maira_qp as mq
from maira_qp.robots.dh.table import DHLink, DHTable


def random_table(rng: np.random.Generator, moving: int, convention: str = "standard") -> DHTable:
    """A DH table of all kinds of links: `moving` joints that move, fixed rows between, offsets, zeros, right angles."""
    links: list[DHLink] = []
    while sum(link.kind != "fixed" for link in links) < moving:
        kind = str(rng.choice(["revolute", "revolute", "continuous", "prismatic", "fixed"]))
        a, d = rng.choice([0.0, 1.0], 2) * rng.uniform(-1, 1, 2)
        alpha, theta = np.where(rng.random(2) < 0.5, rng.integers(-2, 3, 2) * pi / 2, rng.uniform(-4, 4, 2))
        limits = {}
        if kind in ("revolute", "prismatic"):
            lower, upper = np.sort(rng.uniform(-3, 3, 2))
            limits = {"lower": float(lower), "upper": float(upper)}
        links.append(DHLink(kind=kind, a=float(a), alpha=float(alpha), d=float(d), theta=float(theta), **limits))
    return DHTable(links, name="random", convention=convention)


def random_chain(joints: int, rng) -> mq.Robot:
    body = "".join(
        f'<link name="l{i + 1}"/><joint name="j{i}" type="{rng.choice(["revolute", "prismatic", "continuous"])}">'
        f'<parent link="l{i}"/><child link="l{i + 1}"/>'
        f'<origin xyz="{numbers(rng.normal(size=3))}" rpy="{numbers(rng.normal(size=3))}"/>'
        f'<axis xyz="{numbers(axis_of(rng))}"/><limit lower="-2" upper="3" velocity="1" effort="1"/></joint>'
        for i in range(joints)
    )
    return mq.Robot.from_urdf(f'<robot name="random"><link name="l0"/>{body}</robot>')


def numbers(values) -> str:
    return " ".join(repr(float(v)) for v in values)


def axis_of(rng) -> np.ndarray:
    """A skew axis, or one along x, y or z, either way."""
    return rng.normal(size=3) if rng.random() < 0.5 else rng.choice([-1, 1]) * np.eye(3)[rng.integers(3)]


ARM = [
    ("0 0 1", 0.3, 3),
    ("0 1 0", 0.1, 2),
    ("0 1 0", 0.4, 2.5),
    ("0 0 1", 0.2, 3),
    ("0 1 0", 0.2, 2),
    ("0 0 1", 0.1, 3),
]
"""Axis, offset along z [m] and limit [rad] of each joint."""


BASES = {
    "rail": ["1 0 0"],
    "floor": ["1 0 0", "0 1 0"],
    "oblique": ["1 0 0", "0.8 0.6 0"],
    "mast": ["0 0 1"],
    "behind a joint": ["turn", "1 0 0"],
    "within the arm": [],
}


def mobile(base: str, length: float) -> mq.Robot:
    """An arm of six joints on slides of a length [m] in each direction."""
    parts, parent = [], "base"

    def add(kind: str, axis: str, z: float, end: float) -> None:
        nonlocal parent
        name = f"link{len(parts)}"
        limit = "" if kind == "continuous" else f'lower="{-end}" upper="{end}"'
        parts.append(
            f'<link name="{name}"/><joint name="joint{len(parts)}" type="{kind}"><parent link="{parent}"/>'
            f'<child link="{name}"/><origin xyz="0 0 {z}"/><axis xyz="{axis}"/>'
            f'<limit {limit} velocity="1" effort="1"/></joint>'
        )
        parent = name

    for axis in BASES[base]:
        add(*(("continuous", "0 0 1") if axis == "turn" else ("prismatic", axis)), 0.0, length)
    for i, (axis, z, end) in enumerate(ARM):
        add("revolute", axis, z, end)
        if i == 2 and base == "within the arm":
            add("prismatic", "0 0 1", 0.1, length)
    return mq.Robot.from_urdf(f'<robot name="{base}"><link name="base"/>{"".join(parts)}</robot>', tip=parent)
