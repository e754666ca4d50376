"""LeRobot's `RobotKinematics` by maira_qp: a phone moves a desktop arm of five joints, as LeRobot's loop does it.

In LeRobot one line changes, `from maira_qp.integrations.lerobot import RobotKinematics`. LeRobot is not needed here:
the motors are a stand-in. The phone turns as it likes; the gripper is where the phone is, and turned as far as five
joints can. The target then leaves the reach, passes behind the arm and comes back: no joint jumps.
"""

from pathlib import Path

import numpy as np
import pinocchio as pin
from rich import print

from maira_qp.integrations.lerobot import RobotKinematics

FPS = 30
MOTORS = ["shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper"]
kinematics = RobotKinematics(
    urdf_path=str(Path(__file__).parent / "five_joint_arm.urdf"),
    target_frame_name="gripper_frame_link",
    joint_names=MOTORS,  # the gripper is a motor too, and passed on
)


class Motors:
    """A stand-in of the robot: it stands where it was sent."""

    def __init__(self) -> None:
        self.values = dict(zip(MOTORS, [0.0, -40.0, 50.0, 30.0, 0.0, 25.0], strict=True))  # degrees, percent

    def get_observation(self) -> dict[str, float]:
        """Values of the motors."""
        return {f"{name}.pos": value for name, value in self.values.items()}

    def send_action(self, action: dict[str, float]) -> None:
        """Go there."""
        self.values = {name: action[f"{name}.pos"] for name in MOTORS}


robot = Motors()
start = kinematics.forward_kinematics(np.array(list(robot.get_observation().values())))
for title, size in (("within reach", 0.06), ("out of reach, and behind the arm", 0.6)):
    distances, angles, steps = [], [], []
    for frame in range(10 * FPS):
        phase = 2 * np.pi * frame / (5 * FPS)
        desired = start.copy()
        desired[:3, 3] += size * np.array([np.cos(phase) - 1, np.sin(phase), 0.5 * np.sin(2 * phase)])
        desired[:3, :3] = start[:3, :3] @ pin.exp3(
            0.3 * np.array([np.sin(phase), np.sin(2 * phase), np.sin(3 * phase)])
        )
        q = np.array(list(robot.get_observation().values()))
        answer = kinematics.inverse_kinematics(q, desired)
        robot.send_action({f"{name}.pos": float(value) for name, value in zip(MOTORS, answer, strict=True)})
        reached = kinematics.forward_kinematics(answer)
        distances.append(np.linalg.norm(reached[:3, 3] - desired[:3, 3]))
        angles.append(np.degrees(np.linalg.norm(pin.log3(reached[:3, :3].T @ desired[:3, :3]))))
        steps.append(np.abs(answer - q).max())
    print(
        f"{title}: off by at most {1e3 * max(distances):.3g} mm and {max(angles):.0f} degrees, "
        f"largest step of a joint {max(steps[1:]):.1f} degrees, gripper at {answer[-1]:.0f} %"
    )
