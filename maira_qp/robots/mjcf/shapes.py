"""Geoms of a compiled MJCF model as shapes of URDF."""

from __future__ import annotations

import logging
import math
from typing import Any
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from maira_qp.orientation import matrix_from_quaternion
from maira_qp.robots.mjcf.compiled import Compiled, MeshFile, package
from maira_qp.robots.urdf.rpy import rpy_from_matrix

log = logging.getLogger(__name__)

FLOOR = 10.0
"""Half the sides of what stands for a plane without end [m]."""
FLOOR_DEPTH = 0.1
"""Thickness of what stands for a plane [m]."""


def add_shapes(link: Element, compiled: Compiled, body: int) -> None:
    """Add the shapes of a body to its link: what can be collided with, and what is there to be seen.

    Where all shapes can be collided with, these are what is seen. A plane is a box below it; height
    fields, and meshes that are not in a file of their own, have no shape, which is logged.
    """
    model = compiled.model
    first = int(model.body_geomadr[body])
    geoms = range(first, first + int(model.body_geomnum[body])) if first >= 0 else range(0)
    solid = [geom for geom in geoms if model.geom_contype[geom] or model.geom_conaffinity[geom]]
    seen = [geom for geom in geoms if geom not in solid] or solid
    for tag, chosen in (("visual", seen), ("collision", solid)):
        for geom in chosen:
            _add(link, tag, compiled, geom)


def _add(link: Element, tag: str, compiled: Compiled, geom: int) -> None:
    """Add one geom as a `<visual>` or `<collision>`."""
    model = compiled.model
    origin, R = np.array(model.geom_pos[geom]), matrix_from_quaternion(model.geom_quat[geom])
    if geom in compiled.meshes:
        mesh = compiled.meshes[geom]
        if mesh is None:
            log.info("geom %d of link %r has no shape that URDF knows", geom, link.get("name"))
            return
        shape, offset = _mesh(mesh)
    else:
        shape, offset = _primitive(int(model.geom_type[geom]), model.geom_size[geom].tolist())
    if shape is None:
        return
    part = SubElement(link, tag)
    add_origin(part, origin + R @ offset[:3, 3], R @ offset[:3, :3])
    SubElement(part, "geometry").append(shape)
    if tag == "visual":
        material = SubElement(part, "material", name=f"rgba{geom}")
        SubElement(material, "color", rgba=words(compiled.colours[geom]))


def _primitive(kind: int, size: list[float]) -> tuple[Element | None, np.ndarray]:
    """The element of a primitive shape, and its pose (4, 4) in the geom's frame."""
    kinds, offset = package().mjtGeom, np.eye(4)
    if kind == kinds.mjGEOM_SPHERE:
        return Element("sphere", radius=words(size[:1])), offset
    if kind in (kinds.mjGEOM_CAPSULE, kinds.mjGEOM_CYLINDER):
        tag = "capsule" if kind == kinds.mjGEOM_CAPSULE else "cylinder"
        return Element(tag, radius=words(size[:1]), length=words([2 * size[1]])), offset
    if kind == kinds.mjGEOM_ELLIPSOID:
        return Element("ellipsoid", radii=words(size)), offset
    if kind == kinds.mjGEOM_BOX:
        return Element("box", size=words(2 * side for side in size)), offset
    if kind == kinds.mjGEOM_PLANE:
        offset[2, 3] = -0.5 * FLOOR_DEPTH
        return Element("box", size=words([*(2 * (side or FLOOR) for side in size[:2]), FLOOR_DEPTH])), offset
    return None, offset


def _mesh(mesh: MeshFile) -> tuple[Element | None, np.ndarray]:
    """The element of a mesh file, and the pose (4, 4) of what is in it in the geom's frame."""
    R = matrix_from_quaternion(mesh.quaternion / np.linalg.norm(mesh.quaternion)).T
    is_even = math.isclose(mesh.scale.min(), mesh.scale.max(), rel_tol=1e-12)
    offset = np.eye(4)
    if not (is_even or np.allclose(R, np.eye(3), rtol=0, atol=1e-12)):
        log.info("the mesh %s is turned and scaled unevenly, which URDF cannot say", mesh.path)
        return None, offset
    offset[:3, :3], offset[:3, 3] = R, -mesh.scale * (R @ mesh.origin)
    return Element("mesh", filename=mesh.path, scale=words(mesh.scale)), offset


def add_origin(element: Element, position: np.ndarray, R: np.ndarray) -> None:
    """Add an `<origin>` at a position (3,) [m] with a rotation (3, 3)."""
    SubElement(element, "origin", xyz=words(position), rpy=words(rpy_from_matrix(R)))


def words(numbers: Any) -> str:
    """Numbers as text that reads back as the same floats."""
    return " ".join(repr(float(number) + 0.0) for number in numbers)
