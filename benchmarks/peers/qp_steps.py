"""Peers that offer one QP step, Pink and Mink, and the loop with restarts around it that a user writes.

Settings were chosen in the peers' favour from a few trials: short starts with many restarts solve more, sooner.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from itertools import cycle

import numpy as np
import pinocchio as pin

from maira_qp.evaluation.contestant import Contestant
from peers.arms import Arm

ITERATIONS, RESTARTS, CLOSE = 25, 20, 1e-6
"""Steps a start; further starts; the norm of the pose error, m and rad together, that ends the loop."""
SETTINGS = f"daqp, {ITERATIONS} steps a start, {RESTARTS} restarts"


def pink(arm: Arm) -> Contestant:
    """QP steps on Pinocchio."""
    from pink import Configuration, FrameTask, solve_ik
    from pink.exceptions import NoSolutionFound
    from pink.limits import ConfigurationLimit

    model = pin.buildModelFromXML(arm.urdf)
    data = model.createData()
    task = FrameTask(arm.robot.tip, position_cost=1.0, orientation_cost=1.0, lm_damping=1e-8)
    limits = [ConfigurationLimit(model)]
    at = Configuration(model, data, np.clip(pin.neutral(model), arm.lower, arm.upper), copy_data=False)

    def forward(q: np.ndarray) -> np.ndarray:
        at.update(q)
        return at.get_transform_frame_to_world(arm.robot.tip).homogeneous

    def aim(target: pin.SE3) -> None:
        task.set_target(target)

    def advance() -> np.ndarray:
        return at.q + solve_ik(at, [task], 1.0, solver="daqp", limits=limits, safety_break=False)

    def step(q: np.ndarray, target: pin.SE3, dt: float) -> np.ndarray:
        at.update(q)
        task.set_target(target)
        return solve_ik(at, [task], dt, solver="daqp")

    return Contestant(
        name="Pink",
        settings=SETTINGS,
        forward=forward,
        solve=_loop(arm, aim, at.update, lambda: (task.compute_error(at), at.q), advance, NoSolutionFound),
        native=pin.SE3,
        step=step,
        limits=(model.lowerPositionLimit, model.upperPositionLimit),
    )


def mink(arm: Arm) -> Contestant:
    """QP steps on MuJoCo."""
    from mink import SE3, Configuration, ConfigurationLimit, FrameTask, NoSolutionFound, VelocityLimit, solve_ik
    from mujoco import MjModel

    model = MjModel.from_xml_string(_for_mujoco(arm.urdf))
    task = FrameTask(arm.robot.tip, "body", position_cost=1.0, orientation_cost=1.0, lm_damping=1e-8)
    limits = [ConfigurationLimit(model, gain=0.5)]
    speeds = dict(zip(arm.robot.joint_names, arm.judge.speed, strict=True))
    tick_limits = [ConfigurationLimit(model), VelocityLimit(model, speeds)]
    at = Configuration(model, (arm.lower + arm.upper) / 2)

    def forward(q: np.ndarray) -> np.ndarray:
        at.update(q)
        return at.get_transform_frame_to_world(arm.robot.tip, "body").as_matrix()

    def aim(target: SE3) -> None:
        task.set_target(target)

    def advance() -> np.ndarray:
        return at.q + solve_ik(at, [task], 1.0, solver="daqp", limits=limits)

    def step(q: np.ndarray, target: SE3, dt: float) -> np.ndarray:
        at.update(q)
        task.set_target(target)
        return solve_ik(at, [task], dt, solver="daqp", limits=tick_limits)

    return Contestant(
        name="Mink",
        settings=SETTINGS,
        forward=forward,
        solve=_loop(arm, aim, at.update, lambda: (task.compute_error(at), at.q), advance, NoSolutionFound),
        native=SE3.from_matrix,
        step=step,
        limits=tuple(model.jnt_range.T),
    )


def _for_mujoco(urdf: str) -> str:
    """The URDF with the masses that MuJoCo insists on, and its fixed links kept, so that the tip has a name."""
    root = ElementTree.fromstring(urdf)
    compiler = {"boundmass": "1", "boundinertia": "1", "fusestatic": "false"}
    ElementTree.SubElement(ElementTree.SubElement(root, "mujoco"), "compiler", compiler)
    return ElementTree.tostring(root, encoding="unicode")


def _loop(
    arm: Arm,
    aim: Callable,
    place: Callable[[np.ndarray], object],
    look: Callable[[], tuple[np.ndarray, np.ndarray]],
    advance: Callable[[], np.ndarray],
    failure: type[Exception],
) -> Callable[..., np.ndarray | None]:
    """Steps from a start until the pose error is small, then from random starts; a QP that fails ends a start.

    `aim` takes the target, `place` a configuration (n,); `look` returns the pose error (6,) and the configuration,
    `advance` the next configuration, or raises `failure`.
    """
    starts = cycle(arm.configurations(1000, np.random.default_rng(1)))

    def solve(target: object, start: np.ndarray) -> np.ndarray | None:
        aim(target)
        for _ in range(RESTARTS + 1):
            place(start)
            for _ in range(ITERATIONS):
                error, q = look()
                if np.linalg.norm(error) < CLOSE:
                    return q.copy()
                try:
                    q = advance()
                except failure:
                    break
                place(np.clip(q, arm.lower, arm.upper))
            start = next(starts)
        return None

    return solve
