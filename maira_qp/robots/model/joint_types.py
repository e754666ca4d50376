"""Joints of a Pinocchio model that one number moves, as a robot has them: a continuous joint too is one angle."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from maira_qp.errors import RobotError

_PLAIN = {
    f"JointModel{kind}" for kind in ("RX", "RY", "RZ", "PX", "PY", "PZ", "RevoluteUnaligned", "PrismaticUnaligned")
}
_UNBOUNDED = {
    "JointModelRUBX": pin.JointModelRX,
    "JointModelRUBY": pin.JointModelRY,
    "JointModelRUBZ": pin.JointModelRZ,
}
_READ_OFF = {"JointModelRevoluteUnboundedUnaligned", "JointModelMimic"}
"""Joints whose axes Pinocchio's Python interface does not give."""
_ALIGNED = 1e-12
"""An axis is an axis of coordinates if it differs from it by less."""


def is_unbounded(joint: pin.JointModel) -> bool:
    """Whether a joint is a pair (cos, sin) in Pinocchio."""
    return "JointModelRUB" in joint.shortname() or "Unbounded" in joint.shortname()


def is_mimic(joint: pin.JointModel) -> bool:
    """Whether a joint follows another one."""
    return joint.shortname() == "JointModelMimic"


def one_number(model: pin.Model, joint: int) -> pin.JointModel:
    """The joint of a model as one that a single number moves: revolute or prismatic, a mimic joint on its own.

    Raises `RobotError` for other joints, such as free-flyers.
    """
    kind = model.joints[joint].shortname()
    if kind in _PLAIN:
        return model.joints[joint]
    if kind in _UNBOUNDED:
        return pin.JointModel(_UNBOUNDED[kind]())
    if kind in _READ_OFF:
        return _by_its_motion(model, joint)
    name = model.names[joint]
    raise RobotError(
        f"joint {name!r} is a {kind.removeprefix('JointModel')}, which is not supported: joints turn about or slide "
        f"along one axis; start behind it (base=...), or fix it (pinocchio.buildReducedModel(model, [{joint}], q))"
    )


def _by_its_motion(model: pin.Model, joint: int) -> pin.JointModel:
    """The joint that moves as this one does, its axis read off the motion by 1 rad, or 1 m."""
    step, here = np.zeros(model.nv), pin.neutral(model)
    scaling = model.joints[joint].extract().scaling if is_mimic(model.joints[joint]) else 1.0
    step[model.joints[joint].idx_v] = 1 / scaling
    placements, data = [], model.createData()
    for q in (here, pin.integrate(model, here, step)):
        pin.forwardKinematics(model, data, q)
        placements.append(data.liMi[joint].copy())
    motion = pin.log6(placements[0].actInv(placements[1]))
    turns = bool(np.linalg.norm(motion.angular) > 0.5)
    axis = np.array(motion.angular if turns else motion.linear)
    if np.abs(np.abs(axis).max() - 1) < _ALIGNED:
        axis = np.round(axis)
    return pin.JointModel((pin.JointModelRevoluteUnaligned if turns else pin.JointModelPrismaticUnaligned)(axis))
