"""Shapes as URDF: the elements that `maira_qp.robots.collision.link_shapes` reads."""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from maira_qp.errors import OptionError, shown
from maira_qp.robots.collision.shapes import Box, Capsule, Cylinder, Ellipsoid, Mesh, Shape, Sphere
from maira_qp.robots.urdf.rpy import rpy_from_matrix


def collision_element(shape: Any) -> Element:
    """A shape as `<collision>`, its pose as the origin. Raises `OptionError` for what is no shape, or is in no file."""
    if not isinstance(shape, Shape):
        raise OptionError(f"not a shape: {shown(shape)}; valid: Sphere, Ellipsoid, Box, Capsule, Cylinder, Mesh")
    element = Element("collision")
    SubElement(element, "origin", xyz=_words(shape.pose.translation), rpy=_words(rpy_from_matrix(shape.pose.rotation)))
    tag, sizes = _solid(shape)
    SubElement(SubElement(element, "geometry"), tag, sizes)
    return element


def _solid(shape: Shape) -> tuple[str, dict[str, str]]:
    if isinstance(shape, Sphere):
        return "sphere", {"radius": _words([shape.radius])}
    if isinstance(shape, Ellipsoid):
        return "ellipsoid", {"radii": _words(shape.radii)}
    if isinstance(shape, Box):
        return "box", {"size": _words(shape.size)}
    if isinstance(shape, (Capsule, Cylinder)):
        return type(shape).__name__.lower(), {"radius": _words([shape.radius]), "length": _words([shape.length])}
    if isinstance(shape, Mesh) and isinstance(shape.source, (str, os.PathLike)):
        return "mesh", {"filename": os.fspath(shape.source), "scale": _words(shape.scale)}
    raise OptionError("URDF holds no vertices and faces; save the mesh to a file, mq.Mesh('object.stl')")


def without_ellipsoids(urdf: str) -> str:
    """The text of a URDF in which boxes around them stand in for ellipsoids, at which other readers stop."""
    if "<ellipsoid" not in urdf:
        return urdf
    root = ElementTree.fromstring(urdf)
    for solid in root.iter("ellipsoid"):
        radii = solid.attrib.pop("radii", "").split()
        solid.tag = "box"
        solid.set("size", _words(2 * float(radius) for radius in radii))
    return ElementTree.tostring(root, encoding="unicode") + "\n"


def _words(numbers: Iterable[float]) -> str:
    return " ".join(repr(float(number)) for number in numbers)
