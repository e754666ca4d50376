"""What a robot looks like: the `<visual>` elements of its URDF as coloured surfaces, a body or more a link.

Where some of them cannot be drawn, the `<collision>` elements; where these cannot either, what there is and a stick
figure: balls in the joints and rods between them.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin

from maira_qp.apps.viewer.drawing.triangles import Triangles, joined, triangles
from maira_qp.errors import MairaError
from maira_qp.orientation import skew
from maira_qp.robots.collision.link_shapes import shape_of
from maira_qp.robots.collision.meshes import find_mesh, mesh_triangles
from maira_qp.robots.collision.shapes import Capsule, Mesh, Shape, Sphere
from maira_qp.robots.model.robot import Robot

Colour = tuple[int, int, int]
PLAIN: Colour = (205, 209, 216)
"""Of what has no colour of its own."""


@dataclass(frozen=True, eq=False)
class Body:
    """A surface of one colour that moves with a link."""

    link: str
    surface: Triangles
    """In the link's frame"""
    colour: Colour
    is_faceted: bool
    """Its triangles are to be told apart: those of files, whose edges are not known."""


class Geometry(NamedTuple):
    """The bodies of a robot, and what could not be drawn, a sentence each."""

    bodies: list[Body]
    notes: list[str]


def geometry_of(robot: Robot, directories: Sequence[str | os.PathLike[str]] = ()) -> Geometry:
    """What a robot looks like; meshes are sought in `directories`, and left out with a note if not found."""
    root = ElementTree.fromstring(robot.urdf)
    palette = {material.get("name"): colour for material in root.findall("material") if (colour := _rgb(material))}
    drawn: dict[str, Geometry] = {}
    for tag in ("visual", "collision"):
        notes: list[str] = []
        bodies = [body for link in root.findall("link") for body in _bodies(link, tag, palette, directories, notes)]
        if bodies and not notes:
            return Geometry(_merged(bodies), [])
        drawn[tag] = Geometry(_merged(bodies), notes)
    bodies, notes = drawn["visual"]
    return Geometry([*bodies, *stick_figure(robot)], notes or ["no link has a shape: a stick figure is drawn"])


def _bodies(
    link: Element,
    tag: str,
    palette: dict[str | None, Colour],
    directories: Sequence[str | os.PathLike[str]],
    notes: list[str],
) -> list[Body]:
    """The bodies of a link; what cannot be drawn goes into the notes."""
    name, bodies = link.attrib["name"], []
    for element in link.findall(tag):
        try:
            shape = shape_of(element, name)
            surface = _of_file(shape, directories) if isinstance(shape, Mesh) else triangles(shape)
        except (MairaError, OSError) as reason:
            notes.append(f"{tag} of {name}: {reason}")
            continue
        bodies.append(Body(name, surface, _colour(element, palette), isinstance(shape, Mesh)))
    return bodies


def _of_file(mesh: Mesh, directories: Sequence[str | os.PathLike[str]]) -> Triangles:
    """A mesh of a URDF. Raises `FileNotFoundError`, `OptionError`."""
    vertices, faces = mesh_triangles(find_mesh(mesh.source, directories))
    scale = np.array(mesh.scale)
    faces = faces[:, ::-1] if scale.prod() < 0 else faces  # mirrored: inside out
    return Triangles(vertices * scale, faces).moved(mesh.pose.homogeneous)


def _colour(element: Element, palette: dict[str | None, Colour]) -> Colour:
    material = element.find("material")
    if material is None:
        return PLAIN
    return _rgb(material) or palette.get(material.get("name"), PLAIN)


def _rgb(material: Element) -> Colour | None:
    """The colour that a `<material>` holds; None where it holds none that can be read."""
    colour = material.find("color")
    try:
        red, green, blue, _ = (float(word) for word in colour.attrib["rgba"].split())  # type: ignore[union-attr]
        return tuple(round(255 * min(max(part, 0.0), 1.0)) for part in (red, green, blue))  # type: ignore[return-value]
    except (AttributeError, KeyError, ValueError, OverflowError):
        return None


def _merged(bodies: Iterable[Body]) -> list[Body]:
    """Those of one link, one colour and one kind as one body."""
    alike: dict[tuple[str, Colour, bool], list[Triangles]] = {}
    for body in bodies:
        alike.setdefault((body.link, body.colour, body.is_faceted), []).append(body.surface)
    return [Body(link, joined(parts), colour, faceted) for (link, colour, faceted), parts in alike.items()]


# The stick figure

_ROD: Colour = (150, 156, 166)
_BALL: Colour = (41, 115, 204)


def stick_figure(robot: Robot) -> list[Body]:
    """Balls in the joints, and rods from each to the next and to the tips."""
    model, radius = robot.model, 0.02 * robot.length
    links = [robot.base, *robot.moved_links]
    ends = [(int(model.parents[j]), model.jointPlacements[j].translation) for j in range(1, model.njoints)]
    for tip in robot.tips:
        frame = model.frames[robot.frame_id(tip)]
        ends.append((int(frame.parentJoint), frame.placement.translation))
    rods = [Body(links[joint], triangles(_rod(end, radius)), _ROD, False) for joint, end in ends if end.any()]
    balls = [Body(link, triangles(Sphere(1.6 * radius)), _BALL, False) for link in robot.moved_links]
    return rods + balls


def _rod(end: np.ndarray, radius: float) -> Shape:
    """A capsule from the origin to `end` (3,) [m]."""
    length = float(np.linalg.norm(end))
    z = end / length
    x = skew(z)[:, np.abs(z).argmin()]
    x = x / np.linalg.norm(x)
    return Capsule(radius, length, pin.SE3(np.column_stack([x, np.cross(z, x), z]), 0.5 * end))
