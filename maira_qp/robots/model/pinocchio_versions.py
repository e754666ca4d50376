"""What differs between versions of Pinocchio, from 3.4, which `placo` 0.9.15 and so LeRobot 0.5 ask for, to 4.1.

Mimic joints are joints of a model from 3.6 on. Version 4 has a lower and an upper limit of effort, speed and friction
per joint where those before had one number.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from maira_qp.errors import RobotError

HAS_MIMIC = hasattr(pin, "JointModelMimic")
"""Whether a joint of a model can follow another one."""

_OF_VELOCITIES = (
    *("armature", "damping", "rotorInertia", "rotorGearRatio"),
    *(
        ("lowerDryFrictionLimit", "upperDryFrictionLimit", "lowerEffortLimit", "upperEffortLimit")
        if hasattr(pin.Model, "lowerEffortLimit")
        else ("friction", "effortLimit")
    ),
    *(("lowerVelocityLimit", "upperVelocityLimit") if hasattr(pin.Model, "lowerVelocityLimit") else ("velocityLimit",)),
)

_WITH_INFINITY = ("lowerPositionLimit", "upperPositionLimit", *_OF_VELOCITIES)


def copy_velocity_arrays(old: pin.Model, new: pin.Model, places: Sequence[int]) -> None:
    """Give a model those numbers of another one that belong to its velocities, limits of position apart.

    `places` are indices of the old model's velocities, one for each of the new one.
    """
    for key in _OF_VELOCITIES:
        setattr(new, key, np.array(getattr(old, key))[list(places)])


def model_to_pickle(model: pin.Model) -> tuple[pin.Model, dict[str, np.ndarray]]:
    """A model for `pickle`, and the arrays that may hold inf, which versions before 4 do not read back."""
    arrays = {key: np.array(getattr(model, key)) for key in _WITH_INFINITY}
    finite = model.copy()
    for key, array in arrays.items():
        setattr(finite, key, np.zeros_like(array))
    return finite, arrays


def model_from_pickle(model: pin.Model, arrays: dict[str, np.ndarray]) -> pin.Model:
    """The model that `model_to_pickle` was given, in the place of the one that it made."""
    for key, array in arrays.items():
        setattr(model, key, array)
    return model


def mimic_couplings(model: pin.Model) -> list[tuple[int, int]]:
    """Each mimic joint of a model, and the joint that it follows, as indices of joints."""
    if not HAS_MIMIC:
        return []
    return list(zip(model.mimicking_joints, model.mimicked_joints, strict=True))


def check_mimic(follower: str, leader: str) -> None:
    """Raises `RobotError` where no joint of a model can follow another one."""
    if not HAS_MIMIC:
        raise RobotError(
            f"joint {follower!r} mimics {leader!r}, and Pinocchio {pin.__version__} has no joints that do; "
            "pip install 'pin>=3.7'"
        )


def mimic_joint(kind: pin.JointModel, leader: pin.JointModel, multiplier: float, offset: float) -> pin.JointModel:
    """A joint of that kind that follows a leader that stands in a model: q = multiplier * q_leader + offset."""
    follower = pin.JointModel(kind)
    follower.setIndexes(leader.id, leader.idx_q, leader.idx_v, leader.idx_vExtended)
    return pin.JointModelMimic(follower, multiplier, offset)


def jacobian_columns(model: pin.Model) -> tuple[int, list[int]]:
    """Number of columns of Pinocchio's J, where mimic joints have their own, and each joint's column, 0: the first."""
    if not HAS_MIMIC:
        return model.nv, [joint.idx_v for joint in model.joints]
    return model.nvExtended, [joint.idx_vExtended for joint in model.joints]
