"""Obstacles as they are made and typed: a kind, and its sizes in millimetres."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin

from maira_qp.apps.viewer.quantities import MILLI, numbers
from maira_qp.robots.collision.shapes import Box, Capsule, Cylinder, Ellipsoid, Shape, Sphere

KINDS = ("Ball", "Box", "Cylinder", "Capsule")
NAMES_OF_SIZES: dict[type[Shape], tuple[str, ...]] = {
    Sphere: ("radius",),
    Box: ("size x", "y", "z"),
    Cylinder: ("radius", "length"),
    Capsule: ("radius", "length"),
    Ellipsoid: ("radii x", "y", "z"),
}
_ARRAYS: dict[type[Shape], str] = {Box: "size", Ellipsoid: "radii"}
"""Of those whose sizes are one field"""


def solid(kind: str, size: float, pose: pin.SE3, name: str) -> Shape:
    """One of `KINDS`, about so large [m]."""
    if kind == "Ball":
        return Sphere(0.5 * size, pose, name=name)
    if kind == "Box":
        return Box(np.full(3, size), pose, name=name)
    make = Cylinder if kind == "Cylinder" else Capsule
    return make(0.3 * size, 2.0 * size, pose, name=name)


def label_of(shape: Shape) -> str:
    """What its sizes are; empty for one that has none, as a mesh."""
    names = NAMES_OF_SIZES.get(type(shape), ())
    return f"{', '.join(names)} [mm]" if names else ""


def sizes_of(shape: Shape) -> np.ndarray:
    """Its sizes [mm], as many as `label_of` names."""
    names = NAMES_OF_SIZES.get(type(shape), ())
    field = _ARRAYS.get(type(shape))
    return MILLI * np.array([getattr(shape, name) for name in names] if field is None else getattr(shape, field))


def resized(shape: Shape, text: str) -> Shape:
    """The same with sizes that were typed [mm]. Raises `OptionError`."""
    names, field = NAMES_OF_SIZES[type(shape)], _ARRAYS.get(type(shape))
    values = numbers(text, len(names), label_of(shape)) / MILLI
    sizes = dict(zip(names, values.tolist(), strict=True)) if field is None else {field: values}
    return replace(shape, **sizes)  # type: ignore[type-var]
