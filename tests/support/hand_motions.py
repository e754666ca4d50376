"""Motions of a hand, smooth and disturbed, and a tracker that is watched while it follows them."""

import numpy as np
import pinocchio as pin

import maira_qp as mq

NOT_POSES = (
    np.full((4, 4), np.nan),
    np.diag([1.0, 1.0, -1.0, 1.0]),
    np.diag([2.0, 2.0, 2.0, 1.0]),
    np.eye(3),
    np.zeros((4, 4)),
    "a pose",
    {"nobody": np.eye(4)},
    [],
    7.0,
)


def smooth_motion(start: pin.SE3, ticks: int, rng: np.random.Generator, reach=0.3, turn=0.6, slow=60) -> np.ndarray:
    """Poses (ticks, 4, 4) that begin at a pose and wander by about so much [m, rad], smoother the slower."""
    kernel = np.hanning(2 * slow + 1)
    noise = rng.normal(size=(ticks + 2 * slow, 6))
    way = np.array([np.convolve(column, kernel, mode="valid") for column in noise.T]).T
    way = (way - way[0]) / (np.abs(way - way[0]).max(axis=0) + 1e-9)
    way *= np.array([reach] * 3 + [turn] * 3)
    poses = [pin.SE3(pin.exp3(each[3:]) @ start.rotation, start.translation + each[:3]) for each in way]
    return np.array([pose.homogeneous for pose in poses])


class Watched:
    """A tracker all of whose commands are checked."""

    def __init__(self, tracker: mq.Tracker) -> None:
        self.tracker, self.robot = tracker, tracker.solver.robot
        self.q, self.velocity = tracker.q, tracker.velocity
        self.commands: list[mq.Command] = []

    def update(self, target, dt: float = 0.01, **keys) -> mq.Command:
        """A tick; every limit holds, the errors are those of a fresh forward kinematics, and the state is honest."""
        robot, command = self.robot, self.tracker.update(target, dt, **keys)
        v, before = command.velocity, self.velocity
        assert np.isfinite(command.q).all()
        assert (np.abs(v) <= robot.velocity_limit).all()
        inside = (self.q >= robot.lower) & (self.q <= robot.upper)
        assert (command.q >= robot.lower)[inside].all()
        assert (command.q <= robot.upper)[inside].all()
        assert (np.abs(v - before) <= robot.acceleration_limit * dt * (1 + 1e-9) + 1e-12).all()
        assert np.abs(command.q - (self.q + dt * v)).max() <= 1e-12
        np.testing.assert_array_equal(command.q, self.tracker.q)
        if command.state == mq.TrackerState.HOLDING:
            assert command.reason
            assert command.target is None
            assert np.isnan([command.position_error, command.orientation_error]).all()
            if inside.all():  # it brakes, and turns nowhere
                assert (np.abs(v) <= np.abs(before)).all()
                assert (v * before >= 0).all()
        else:
            self.check_errors(command)
            self.check_state(command, dt)
        self.q, self.velocity = command.q, v
        self.commands.append(command)
        return command

    def check_errors(self, command: mq.Command) -> None:
        """The errors are those of the pose that the command leads to, by forward kinematics."""
        frames = self.tracker.solver.problem.target_keys
        targets = command.target if len(frames) > 1 else {frames[0]: command.target}
        errors = [mq.pose_error(self.robot.forward(command.q, frame), T) for frame, T in targets.items()]
        position = max(np.linalg.norm(e[:3]) for e in errors)
        orientation = max(np.linalg.norm(e[3:]) for e in errors)
        assert abs(command.position_error - position) < 1e-9
        assert abs(command.orientation_error - orientation) < 1e-7

    def check_state(self, command: mq.Command, dt: float) -> None:
        """What is FOLLOWING is at the target, or did all that a tick can; what is LIMITED names limits that hold."""
        robot, speed = self.robot, np.abs(command.velocity)
        change = np.abs(command.velocity - self.velocity)
        if command.state == mq.TrackerState.FOLLOWING:
            assert command.reason == ""
            if command.position_error > 5e-3 or command.orientation_error > 5e-2:
                way = (speed * np.where(robot.slides, 1 / robot.length, 1)).sum() * dt
                assert command.position_error <= 5e-3 + 0.5 * robot.length * way**2
                assert command.orientation_error <= 5e-2 + 0.5 * way**2
                assert (speed < robot.velocity_limit).all()
            return
        assert command.reason
        assert command.position_error > 5e-3 or command.orientation_error > 5e-2
        for part in command.reason.split("; "):
            if " of " not in part or part.startswith("out of"):
                continue
            kind, names = part.split(" of ", 1)
            joints = [robot.joint_names.index(name) for name in names.split(", which")[0].split(", ")]
            if kind == "speed limit":
                assert (speed[joints] >= (1 - 1e-6) * robot.velocity_limit[joints]).all()
            elif kind == "upper limit":
                assert (command.q[joints] >= robot.upper[joints] - 1e-8).all()
            elif kind == "lower limit":
                assert (command.q[joints] <= robot.lower[joints] + 1e-8).all()
            elif kind == "acceleration limit" and "brake for" not in part:
                assert (change[joints] >= (1 - 1e-5) * robot.acceleration_limit[joints] * dt).all()


def disturbed(hands: np.ndarray, rng: np.random.Generator):
    """The poses with gaps, jumps, flights out of reach, and what is no pose, in turn."""
    kind, left, offset = "fine", 0, np.zeros(3)
    for T in hands:
        if left == 0:
            kind = rng.choice(["fine", "fine", "fine", "gap", "jump", "flight", "noise", "broken"])
            left = int(rng.integers(1, 100))
            offset = rng.normal(size=3)
        left -= 1
        moved = T.copy()
        if kind == "gap":
            yield None
        elif kind == "broken":
            yield NOT_POSES[rng.integers(len(NOT_POSES))]
        else:
            moved[:3, 3] += {"jump": offset, "noise": 0.01 * rng.normal(size=3)}.get(kind, 0.0)
            if kind == "flight":
                moved[:3, 3] += 0.02 * left * offset / np.linalg.norm(offset)
            yield moved
