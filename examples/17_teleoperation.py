"""Teleoperation: MAIRA repeats the motion of a hand, recorded at 100 Hz, with all that goes wrong in a recording.

The hand is given in a frame with y up, as headsets have it. The grip of the controller is the clutch: while it is
pressed the tool moves as the hand does, at 0.8 of its way. The recording has a gap, after which the hand is elsewhere
and the operator presses again; a jump of the tracking, which comes back by itself; a pause; and a reach that is too
long for the arm.
"""

import numpy as np
import pinocchio as pin
from rich import print

import maira_qp as mq
from maira_qp.apps import plots

DT, TICKS = 0.01, 1600  # [s]
times = DT * np.arange(TICKS)


def recorded_hand(rng: np.random.Generator) -> list[pin.SE3 | None]:
    """A smooth random motion of some 20 cm and 30 degrees, and what a tracking makes of it."""
    window = np.hanning(401)
    noise = rng.normal(size=(TICKS + 400, 6))
    way = np.array([np.convolve(column, window, mode="valid") for column in noise.T]).T
    way *= np.array([0.2] * 3 + [0.5] * 3) / np.abs(way).max(axis=0)
    way[:, 2] -= 1.2 * np.exp(-(((times - 9.5) / 0.7) ** 2))  # z points to the operator: far ahead and back
    way[:, :3] += 0.0003 * rng.normal(size=(TICKS, 3))  # the tracking's noise
    hand = [pin.SE3(pin.exp3(each[3:]), np.array([0.2, 1.1, -0.4]) + each[:3]) for each in way]
    for k in range(400, 425):
        hand[k].translation += np.array([0.0, 0.35, 0.0])  # for 0.25 s the tracking takes something else for the hand
    return [None if 200 <= k < 280 else pose for k, pose in enumerate(hand)]


hand = recorded_hand(np.random.default_rng(4))
pauses = ((times > 3.0) & (times < 3.2)) | ((times > 5.0) & (times < 6.0))
grip = (times > 0.3) & ~pauses  # the button of the controller
robot = mq.Robot.maira().limited(velocity=2.0, acceleration=15.0)  # [rad/s], [rad/s²]
solver = mq.Solver(robot, redundancy=mq.Strict(mq.Posture()))
y_up = np.array([[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])  # ahead is -z there and x here, up y and z
clutch = mq.Clutch(scale=0.8, alignment=y_up)
start = np.radians([0.0, 30.0, 0.0, 70.0, 0.0, 60.0, 0.0])
tracker = mq.Tracker(solver, start, clutch=clutch, timeout=0.3)

commands: list[mq.Command] = []
story, told = "", -1.0
for time, pose, pressed in zip(times, hand, grip, strict=True):
    if pressed:
        tracker.engage()
    else:
        tracker.release()
    command = tracker.update(pose, DT)  # command.q and command.velocity are for the robot
    commands.append(command)
    now = f"{command.state:9s} {' '.join(command.reason.split()[:2])}"  # without numbers
    if now != story and time > told + 0.1:
        print(f"[bold]{time:5.2f} s[/] {command.state:9s} {command.reason.split(' (')[0]}")
        story, told = now, time

speeds = np.array([command.velocity for command in commands])
accelerations = np.abs(np.diff(speeds, axis=0, prepend=0 * speeds[:1])) / DT
states = np.array([command.state for command in commands])
for state in mq.TrackerState:
    print(f"{state:9s} {DT * (states == state).sum():5.2f} s")
print(f"largest speed {np.abs(speeds).max():.6f} of {robot.velocity_limit[0]} rad/s,", end=" ")
print(f"largest acceleration {accelerations.max():.6f} of {robot.acceleration_limit[0]} rad/s²")

picture = plots.figure(2, 1, size=(8.0, 6.0))
above, below = picture.axes
tool = np.array([robot.forward(command.q).translation for command in commands])
asked = np.array([np.full(3, np.nan) if command.target is None else command.target[:3, 3] for command in commands])
for i, axis in enumerate("xyz"):
    above.plot(times, asked[:, i], color=plots.COLORS[i], linewidth=1.0, linestyle="--")
    above.plot(times, tool[:, i], color=plots.COLORS[i], label=f"tool {axis}")
above.set(ylabel="position [m], dashed: target")
for i, speed in enumerate(speeds.T):
    below.plot(times, speed, color=plots.COLORS[i], label=robot.joint_names[i])
below.set(xlabel="time [s]", ylabel="joint speed [rad/s]")
for ax in (above, below):
    bottom, top = ax.get_ylim()
    ax.fill_between(
        times, bottom, top, where=states == mq.TrackerState.HOLDING, color=plots.LIMIT_COLOR, alpha=0.25, linewidth=0
    )
    ax.set_ylim(bottom, top)
    ax.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False)
picture.suptitle("teleoperation: the hand, and what the arm makes of it")
print(f"Picture: {plots.save(picture, 'output/17_teleoperation.png')}")
