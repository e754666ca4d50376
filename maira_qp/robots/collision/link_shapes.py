"""The collision shapes of a robot's links, from the `<collision>` elements of its description.

The format: http://wiki.ros.org/urdf/XML/link; `<capsule radius length>` and `<ellipsoid radii>` beside the four of the
standard.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Iterable
from typing import NamedTuple
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin

from maira_qp.errors import MairaError, OptionError, RobotError, listed
from maira_qp.robots.collision.meshes import THICKNESS
from maira_qp.robots.collision.shapes import Box, Capsule, Cylinder, Ellipsoid, Mesh, Shape, Sphere
from maira_qp.robots.model.robot import Robot
from maira_qp.robots.urdf.rpy import matrix_from_rpy

log = logging.getLogger(__name__)

KINDS = ("sphere", "ellipsoid", "box", "cylinder", "capsule", "mesh")

FLAT = 1e-9
"""What a scale of zero of a mesh becomes: the hull is flat then, and is given `THICKNESS`, whatever the mesh's unit."""


class LinkShape(NamedTuple):
    """A shape, its pose in the link that it belongs to."""

    link: str
    shape: Shape


def link_shapes(
    robot: Robot, directories: Iterable[str | os.PathLike[str]] = (), ignore_missing: bool = False
) -> list[LinkShape]:
    """All collision shapes of a robot; meshes become their convex hulls.

    They are sought in `directories`, and then above the file that the robot is from.

    Raises `OptionError` for a mesh file that is not found, unless missing ones are ignored with a warning; `RobotError`
    for a description that makes no sense.
    """
    directories = (*directories, *robot.mesh_folders)
    shapes: list[LinkShape] = []
    for link in ElementTree.fromstring(robot.urdf).findall("link"):
        for element in link.findall("collision"):
            name = link.attrib["name"]
            try:
                shapes.append(LinkShape(name, shape_of(element, name).loaded(directories)))
            except FileNotFoundError as reason:
                if not ignore_missing:
                    raise OptionError(
                        f"link {name!r}: {reason}; name directories (meshes=[...]), or leave it out (missing='ignore')"
                    ) from None
                log.warning("link %r is without a collision shape: %s", name, reason)
            except MairaError as reason:
                raise RobotError(f"a collision shape of link {name!r}: {reason}") from None
    return shapes


def shape_of(element: Element, link: str) -> Shape:
    """The shape of a `<collision>` or `<visual>`, without its file.

    Sizes of zero, such as those of a sheet, become `THICKNESS`, scales of zero `FLAT`. Raises `RobotError`;
    `OptionError` for other sizes.
    """
    geometry, origin = element.find("geometry"), element.find("origin")
    solid = next((part for part in geometry if part.tag in KINDS), None) if geometry is not None else None
    if solid is None:
        raise RobotError(f"it has no geometry; {listed(KINDS)}")
    pose = pin.SE3.Identity() if origin is None else _pose(origin)
    if solid.tag == "sphere":
        return Sphere(_size(solid, "radius"), pose, name=link)
    if solid.tag == "ellipsoid":
        return Ellipsoid([size or THICKNESS for size in _numbers(solid, "radii")], pose, name=link)
    if solid.tag == "box":
        return Box([size or THICKNESS for size in _numbers(solid, "size")], pose, name=link)
    if solid.tag in ("cylinder", "capsule"):
        kind = Cylinder if solid.tag == "cylinder" else Capsule
        return kind(_size(solid, "radius"), _size(solid, "length"), pose, name=link)
    if not solid.get("filename"):
        raise RobotError("its mesh names no file")
    scale = [factor or FLAT for factor in _numbers(solid, "scale", "1 1 1")]
    return Mesh(solid.attrib["filename"], pose, scale, name=link)


def _pose(origin: Element) -> pin.SE3:
    xyz, rpy = _numbers(origin, "xyz", "0 0 0"), _numbers(origin, "rpy", "0 0 0")
    if len(xyz) != 3 or len(rpy) != 3:
        raise RobotError(f"xyz and rpy of its origin should be 3 numbers each, not {xyz} and {rpy}")
    return pin.SE3(matrix_from_rpy(np.array(rpy)), np.array(xyz))


def _size(element: Element, key: str) -> float:
    """A size [m], `THICKNESS` for zero."""
    return _number(element, key) or THICKNESS


def _number(element: Element, key: str) -> float:
    numbers = _numbers(element, key)
    if len(numbers) != 1:
        raise RobotError(f"{key} of its {element.tag} should be one number, not {numbers}")
    return numbers[0]


def _numbers(element: Element, key: str, default: str = "") -> list[float]:
    text = element.get(key, default)
    try:
        numbers = [float(word) for word in text.split()]
    except ValueError:
        raise RobotError(f"{key}={text[:80]!r} of its {element.tag} is not made of numbers") from None
    if not np.isfinite(numbers).all():
        raise RobotError(f"{key}={text[:80]!r} of its {element.tag} is not finite")
    return numbers
