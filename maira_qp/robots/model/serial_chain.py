"""A robot's chain as the array that the kernels of the search work on."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from maira_qp.kernels.kinematics.serial_chain import ROW
from maira_qp.robots.model.arrays import KinematicTree

if TYPE_CHECKING:
    from maira_qp.robots.model.robot import Robot


def chain_of(robot: Robot) -> np.ndarray:
    """The chain (n + 1, 17) of `kernels.kinematics.serial_chain`: each joint's frame turned so that it moves along z.

    The robot must be a chain, `Robot.is_chain`.
    """
    tree, chain = KinematicTree.of(robot), np.zeros((robot.n + 1, ROW))
    chain[:-1] = tree.joints[:, :ROW]
    chain[-1, :12] = tree.frame(None)[1]
    return chain
