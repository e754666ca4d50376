"""A normalised URDF as a Pinocchio model: the importer between `read_urdf` and `Robot.from_model`."""

from __future__ import annotations

import math
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin

from maira_qp.errors import RobotError
from maira_qp.robots.model.reduced import independent
from maira_qp.robots.urdf.reader import Chain
from maira_qp.robots.urdf.sum_limits import TAG


def model_of(chain: Chain) -> tuple[pin.Model, dict[str, tuple[str, float, float]]]:
    """Pinocchio's model of a chain, without meshes and uncoupled, and {follower: (leader, multiplier, offset)}.

    Raises `RobotError`.
    """
    root = ElementTree.fromstring(chain.urdf)
    joints = root.findall("joint")
    names = [joint.attrib["name"] for joint in joints]
    found = {joint.attrib["name"]: joint.find("mimic") for joint in joints}
    mimic = {name: _coupling(element) for name, element in found.items() if element is not None}
    try:
        model = pin.buildModelFromXML(_for_pinocchio(root))
    except (ValueError, RuntimeError, IndexError) as reason:
        raise RobotError(f"Pinocchio cannot use the description of {chain.name!r}: {reason}") from None
    for index in range(1, model.njoints):
        model.names[index] = names[int(model.names[index])]
    for frame in model.frames:
        if frame.type in (pin.FrameType.JOINT, pin.FrameType.FIXED_JOINT) and frame.name != "universe":
            frame.name = names[int(frame.name)]
    free = independent(model, mimic)
    for key in ("lower", "upper"):
        _set(model, f"{key}PositionLimit", free, getattr(chain, key))
    for key in ("velocity", "effort"):
        _set(model, f"{key}Limit", free, getattr(chain, key))
    return model, mimic


def _coupling(mimic: Element) -> tuple[str, float, float]:
    return mimic.attrib["joint"], float(mimic.attrib["multiplier"]), float(mimic.attrib["offset"])


def _set(model: pin.Model, key: str, places: list[int], values: np.ndarray) -> None:
    array = np.array(getattr(model, key))
    array[places] = values
    setattr(model, key, array)


def _for_pinocchio(root: Element) -> str:
    """The normalised URDF as Pinocchio needs it.

    Pinocchio makes a continuous joint a pair (cos, sin), so it becomes revolute here. It visits the joints under a link
    in the order of their names, so they are named by their order. Shapes and limits of sums are left out, and so are
    masses that it could not read.
    """
    for limit in root.findall(TAG):
        root.remove(limit)
    for link in root.findall("link"):
        for part in list(link):
            if part.tag != "inertial" or not _is_readable(part):
                link.remove(part)
    ranks = {joint.attrib["name"]: f"{rank:06d}" for rank, joint in enumerate(root.findall("joint"))}
    for joint in root.findall("joint"):
        joint.set("name", ranks[joint.attrib["name"]])
        for mimic in joint.findall("mimic"):
            mimic.set("joint", ranks[mimic.attrib["joint"]])
        if joint.get("type") == "continuous":
            joint.set("type", "revolute")
            for limit in joint.findall("limit"):
                limit.attrib |= {"lower": "-1", "upper": "1"}  # any: the true ones are set on the model
    return ElementTree.tostring(root, encoding="unicode")


def _is_readable(inertial: Element) -> bool:
    """Whether a mass and an inertia tensor are there, and all of their numbers are finite."""
    mass, inertia = inertial.find("mass"), inertial.find("inertia")
    if mass is None or inertia is None or not {"ixx", "ixy", "ixz", "iyy", "iyz", "izz"} <= set(inertia.attrib):
        return False
    try:
        words = [word for part in inertial for text in part.attrib.values() for word in text.split()]
        return "value" in mass.attrib and all(math.isfinite(float(word)) for word in words)
    except ValueError:
        return False
