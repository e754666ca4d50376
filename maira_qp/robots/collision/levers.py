"""How fast the parts of a robot can move at most."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from maira_qp.robots.collision.scene import Part, radius_of
from maira_qp.robots.model.pinocchio_versions import jacobian_columns


def levers(model: pin.Model, own: Sequence[Part]) -> np.ndarray:
    """Bounds (n,) on the speed of any point of the parts for a joint speed of one [m/rad, or 1].

    A turning joint's is the length of what it carries, stretched out.
    """
    reach = np.zeros(model.njoints)
    for part in own:
        farthest = float(np.linalg.norm(part.placement.translation)) + radius_of(part.shape)
        reach[part.joint] = max(reach[part.joint], farthest)
    data = model.createData()
    J = pin.computeJointJacobians(model, data, pin.neutral(model)).reshape(6, -1)
    columns, found = jacobian_columns(model)[1], np.zeros(model.nv)
    for index in range(model.njoints - 1, 0, -1):
        joint, parent = model.joints[index], model.parents[index]
        turn = float(np.linalg.norm(J[3:, columns[index]]))
        slide = 0.0 if turn else float(np.linalg.norm(J[:3, columns[index]]))
        found[joint.idx_v] += turn * reach[index] + slide
        limits = model.lowerPositionLimit[joint.idx_q], model.upperPositionLimit[joint.idx_q]
        travel = slide * max(map(abs, limits)) if slide else 0.0
        offset = float(np.linalg.norm(model.jointPlacements[index].translation))
        reach[parent] = max(reach[parent], offset + travel + reach[index])
    return found
