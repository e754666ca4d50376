"""An MJCF file or text as MuJoCo compiles it: defaults, includes, angles and frames are resolved by MuJoCo itself.

What kinematics does not need is taken out before: textures, skins, sensors, and soft bodies with their equalities are
deleted, and each geom with a mesh or a height field becomes a small sphere in its place, so that no such file is opened
and none that is missing refuses the model. The file of a mesh is kept by its name. The format:
https://mujoco.readthedocs.io, "XML Reference".
"""

from __future__ import annotations

import importlib
import os
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from maira_qp.errors import RobotError
from maira_qp.robots.urdf.safe_xml import is_text, xml_root

SMALL = 1e-3
"""Radius of the sphere in the place of a mesh [m]."""
LEAST_MASS = 1e-9
"""Mass [kg] and inertia [kg m^2] that MuJoCo gives to bodies that have none without their meshes."""


@dataclass(frozen=True)
class MeshFile:
    """The file of a mesh, whose vertices v stand at `scale * R(quaternion)^T (v - origin)` in the geom."""

    path: str
    scale: np.ndarray
    origin: np.ndarray
    quaternion: np.ndarray


@dataclass(frozen=True)
class Compiled:
    """A compiled model, and what was taken out of it."""

    model: Any
    """`mujoco.MjModel`"""
    name: str
    meshes: dict[int, MeshFile | None]
    """Geoms that are no primitive shapes, by their index: the file of the mesh, None where there is none."""
    colours: np.ndarray
    """Colour of each geom (ngeom, 4), that of its material where it has one."""
    weighed: np.ndarray
    """Which bodies (nbody,) have a mass that does not hang on what was taken out."""


def compiled(source: str | os.PathLike[str]) -> Compiled:
    """The model of an MJCF file, or of text that begins with `<`, which `mujoco` compiles without its assets.

    Raises `RobotError` if the `mujoco` package is missing, for what is no MJCF, and for what MuJoCo refuses.
    """
    root = xml_root(source)
    if root.tag != "mujoco":
        remedy = {
            "robot": "; a URDF goes to Robot.from_urdf",
            "mujocoinclude": ", a part that other files include",
        }.get(root.tag, "")
        raise RobotError(f"not an MJCF model: the outermost element is <{root.tag}>, not <mujoco>{remedy}")
    mujoco = package()
    what = "the MJCF text" if is_text(source) else Path(source).name
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            spec = mujoco.MjSpec.from_string(source) if is_text(source) else mujoco.MjSpec.from_file(os.fspath(source))
            meshes, colours, hollow = _strip(mujoco, spec)
            model = spec.compile()
    except (ValueError, TypeError, RuntimeError, OSError, mujoco.FatalError) as reason:
        raise RobotError(f"MuJoCo cannot use {what}: {' '.join(str(reason).split())[:500]}") from None
    weighed = model.body_mass > 2 * LEAST_MASS
    weighed[[body.id for body in spec.bodies if body.id in hollow and not body.explicitinertial]] = False
    return Compiled(model, str(spec.modelname) or "robot", meshes, np.array(colours).reshape(-1, 4), weighed)


def package() -> Any:
    """The `mujoco` package. Raises `RobotError` if it is not installed."""
    try:
        return importlib.import_module("mujoco")
    except ImportError:
        raise RobotError("MJCF is read by MuJoCo, which is not installed: pip install 'maira-qp[mujoco]'") from None


def _strip(mujoco: Any, spec: Any) -> tuple[dict[int, MeshFile | None], list[np.ndarray], set[int]]:
    """Take out of a specification what kinematics does not need.

    What is left of it: files of meshes and colours by the order of the geoms, and the bodies that lost shapes.
    """
    solid = mujoco.mjtGeom
    files = {mesh.name: mesh for mesh in spec.meshes}
    tints = {material.name: material.rgba for material in spec.materials}
    meshes, colours, hollow = dict[int, MeshFile | None](), [], list[Any]()
    for index, geom in enumerate(spec.geoms):
        colours.append(np.array(tints.get(geom.material, geom.rgba), dtype=float))
        geom.material = ""
        if geom.meshname or geom.type in (solid.mjGEOM_MESH, solid.mjGEOM_HFIELD, solid.mjGEOM_SDF):
            is_plain = geom.type == solid.mjGEOM_MESH and geom.meshname in files
            meshes[index] = _file(spec, files[geom.meshname]) if is_plain else None
            geom.meshname = geom.hfieldname = ""
            geom.type, geom.size = solid.mjGEOM_SPHERE, [SMALL, 0, 0]
            geom.fromto = np.full(6, np.nan)
            hollow.append(geom.parent)
    for part in (*spec.sites, *spec.tendons):
        part.material = ""
    dead = (spec.sensors, spec.skins, spec.flexes, spec.pairs, spec.meshes, spec.hfields, spec.materials, spec.textures)
    kinds = mujoco.mjtEq
    known = (kinds.mjEQ_CONNECT, kinds.mjEQ_WELD, kinds.mjEQ_JOINT, kinds.mjEQ_TENDON)  # others are of soft bodies
    soft = [equality for equality in spec.equalities if equality.type not in known]
    for part in [*soft, *(part for parts in dead for part in parts)]:
        spec.delete(part)
    compiler = spec.compiler
    compiler.fusestatic = compiler.discardvisual = compiler.usethread = False
    compiler.balanceinertia = True
    if compiler.settotalmass > 0:
        compiler.settotalmass = -1
    compiler.boundmass = max(compiler.boundmass, LEAST_MASS)
    compiler.boundinertia = max(compiler.boundinertia, LEAST_MASS)
    return meshes, colours, {body.id for body in hollow}


def _file(spec: Any, mesh: Any) -> MeshFile | None:
    """Where a mesh is read from, None where it stands in the model itself or is made by MuJoCo."""
    if not mesh.file:
        return None
    folder = getattr(mesh.compiler, "meshdir", "") or spec.meshdir
    path = Path(spec.modelfiledir or ".", folder, mesh.file)
    return MeshFile(str(path), np.array(mesh.scale), np.array(mesh.refpos), np.array(mesh.refquat))
