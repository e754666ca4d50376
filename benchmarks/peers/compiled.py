"""Peers that solve in compiled code and are called once a target: Robotics Toolbox, OptIK, TRAC-IK, cartan, dynibo."""

from __future__ import annotations

from itertools import cycle, pairwise

import numpy as np
import pinocchio as pin

from maira_qp.evaluation.contestant import Contestant
from peers.arms import Arm


def robotics_toolbox(arm: Arm) -> Contestant:
    """Levenberg-Marquardt in C++ with random restarts; the chain as constant transforms between turns about z."""
    from roboticstoolbox import ET, ETS

    frames = _frames(arm)
    ets = ETS()
    for i, (before, after) in enumerate(pairwise(frames[:-1])):
        joint = ET.Rz(jindex=i, qlim=[arm.lower[i], arm.upper[i]])
        ets = ets * ET.SE3(np.linalg.solve(before, after)) * joint
    ets = ets * ET.SE3(np.linalg.solve(frames[-2], frames[-1]))

    def solve(target: np.ndarray, start: np.ndarray | None) -> np.ndarray | None:
        # its error is half the squared residual, in m and rad together
        answer = ets.ik_LM(target, q0=start, slimit=100, tol=5e-13, joint_limits=True, k=0.1, method="chan")
        return answer.q if answer.success else None

    return Contestant(
        name="Robotics Toolbox",
        settings="ik_LM chan, k 0.1, tol 5e-13, 100 searches",
        forward=lambda q: np.asarray(ets.eval(q)),
        solve=solve,
        draws_starts=True,
        limits=tuple(ets.qlim),
    )


def _frames(arm: Arm) -> list[np.ndarray]:
    """Poses (4, 4) at q = 0: the base, a frame on each joint with z along its axis, the tool."""
    axes, points, home = arm.screws()
    frames = [np.eye(4)]
    for z, point in zip(axes, points, strict=True):
        x = np.cross(z, np.eye(3)[np.argmin(np.abs(z))])
        x /= np.linalg.norm(x)
        frames.append(np.eye(4))
        frames[-1][:3] = np.column_stack([x, np.cross(z, x), z, point])
    return [*frames, home]


def optik(arm: Arm) -> Contestant:
    """SLSQP on the logarithm of SE(3) with random restarts, in Rust."""
    from optik import Robot, SolverConfig

    robot = Robot.from_urdf_file(str(arm.path), arm.robot.base, arm.robot.tip)
    robot.set_parallelism(1)
    config = SolverConfig(solution_mode="speed", tol_f=1e-14, max_time=0.1, max_restarts=2**31)

    def solve(target: np.ndarray, start: np.ndarray) -> np.ndarray | None:
        answer = robot.ik(config, target, start)
        return None if answer is None else np.array(answer[0])

    return Contestant(
        name="OptIK",
        settings="speed, tol_f 1e-14, at most 0.1 s",
        forward=lambda q: np.array(robot.fk(q)),
        solve=solve,
        limits=robot.joint_limits(),
    )


def trac_ik(arm: Arm) -> Contestant:
    """Newton with random restarts and SLSQP side by side, in C++: two threads, which cannot be changed."""
    import pytracik

    solver = pytracik.TRAC_IK(arm.robot.base, arm.robot.tip, arm.urdf, 0.005, 5e-7, pytracik.SolveType.Speed)

    def solve(target: tuple[float, ...], start: np.ndarray) -> np.ndarray | None:
        answer = pytracik.ik(solver, start, *target)
        return answer[1:] if answer[0] >= 0 else None

    return Contestant(
        name="TRAC-IK",
        settings="speed, epsilon 5e-7, at most 5 ms, two threads",
        forward=lambda q: pytracik.fk(solver, q),
        solve=solve,
        native=lambda target: (*target[:3, 3], *pin.Quaternion(target[:3, :3]).coeffs()),
        limits=(pytracik.get_joint_lower_bounds(solver), pytracik.get_joint_upper_bounds(solver)),
    )


def cartan(arm: Arm) -> Contestant:
    """Projected Levenberg-Marquardt with restarts on a Halton sequence, in C++."""
    import cartan as library

    axes, points, home = arm.screws()
    chain = library.KinematicChain(
        library.SE3.from_matrix(home),
        [library.ScrewAxis.revolute(axis, point) for axis, point in zip(axes, points, strict=True)],
        [library.JointLimits(low, high) for low, high in zip(arm.lower, arm.upper, strict=True)],
    )
    config = library.IkConfig(max_iterations_per_attempt=50, max_total_work_units=5000, max_total_iterations=10000)

    def solve(target: library.SE3, start: np.ndarray) -> np.ndarray | None:
        answer = library.solve_ik_speed(chain, target, start, config)
        return answer.q if answer.converged else None

    return Contestant(
        name="cartan",
        settings="solve_ik_speed, 50 iterations a start, 5000 in all",
        forward=lambda q: library.forward_kinematics(chain, q).matrix(),
        solve=solve,
        native=library.SE3.from_matrix,
    )


def dynibo(arm: Arm) -> Contestant:
    """A damped and clamped Newton method in Rust; the restarts are ours."""
    from dynibo import IkOptions, Pose, Robot, SolverError

    robot = Robot.from_urdf(str(arm.path))
    tip, options = robot.link_id(arm.robot.tip), IkOptions(max_iterations=30)
    starts = cycle(arm.configurations(1000, np.random.default_rng(1)))

    def solve(target: Pose, start: np.ndarray) -> np.ndarray | None:
        for _ in range(100):
            try:
                return robot.inverse_kinematics(start, tip, target, options)
            except SolverError:
                start = next(starts)
        return None

    def pose(target: np.ndarray) -> Pose:
        return Pose(tuple(target[:3, 3]), tuple(pin.Quaternion(target[:3, :3]).coeffs()))

    def forward(q: np.ndarray) -> np.ndarray:
        at = robot.forward_kinematics(q, tip)
        return pin.SE3(pin.Quaternion(np.array(at.rotation_xyzw)), np.array(at.translation)).homogeneous

    return Contestant(
        name="dynibo", settings="30 iterations a start, 100 starts", forward=forward, solve=solve, native=pose
    )
