"""LeRobot's kinematics by maira_qp: the calls that LeRobot makes, on an arm of five joints and a gripper."""

import inspect
import pickle
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from maira_qp.errors import ConfigurationError, FrameError, OptionError, PoseError, RobotError
from maira_qp.integrations.lerobot import RobotKinematics

ARM = Path(__file__).parents[3] / "examples" / "five_joint_arm.urdf"
MOTORS = ["shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper"]
START = np.array([5.0, -40.0, 50.0, 30.0, 10.0, 42.0])
"""Degrees; the gripper's value is a percentage."""


@pytest.fixture(scope="module")
def arm():
    return RobotKinematics(str(ARM))


class Pipeline:
    """A stand-in of LeRobot's processor: end-effector poses as numbers in, motor values by name out."""

    def __init__(self, kinematics, **weights):
        self.kinematics, self.weights = kinematics, weights

    def pose(self, motors):
        """Position (3,) [m] and rotation vector (3,) [rad] where motors {name.pos: degrees} stand."""
        T = self.kinematics.forward_kinematics(np.array([float(motors[f"{name}.pos"]) for name in MOTORS]))
        return T[:3, 3], pin.log3(T[:3, :3])

    def action(self, motors, position, rotation_vector):
        """Motors {name.pos: degrees} for a pose, from where they stand."""
        q = np.array([float(value) for key, value in motors.items() if key.endswith(".pos")], dtype=float)
        T = np.eye(4, dtype=float)
        T[:3, :3], T[:3, 3] = pin.exp3(np.array(rotation_vector)), position
        answer = self.kinematics.inverse_kinematics(q, T, **self.weights)
        return {f"{name}.pos": float(answer[i]) for i, name in enumerate(MOTORS)}


def pinocchio_pose(q):
    """Of the gripper frame, at degrees (6,), by Pinocchio alone."""
    model = pin.buildModelFromUrdf(str(ARM))
    data = model.createData()
    pin.framesForwardKinematics(model, data, np.radians(q))
    return data.oMf[model.getFrameId("gripper_frame_link")].homogeneous


LIMITS = np.array([1.9, 1.75, 1.7, 1.65, 2.75])
"""Of the arm's joints, to both sides [rad]."""
REGULAR = np.array([[-80.0, -60, 20, -30, -100], [80.0, -10, 70, 10, 100]])
"""Degrees between which the arm is in no singularity: the elbow bent, the gripper neither up nor down."""


def smooth_path(rng, n=150):
    """Configurations (n, 5) [degrees] along a random smooth motion away from singularities and limits."""
    corners = rng.uniform(*REGULAR, (4, 5))
    s = np.linspace(0, 1, n)[:, None]
    weights = (1 - s) ** 3, 3 * s * (1 - s) ** 2, 3 * s**2 * (1 - s), s**3
    return sum(weight * corner for weight, corner in zip(weights, corners, strict=True))


def test_signatures_are_those_of_lerobot():
    """The same names, order and defaults; what is more is keyword only."""
    made = inspect.signature(RobotKinematics).parameters
    assert list(made)[:3] == ["urdf_path", "target_frame_name", "joint_names"]
    assert made["target_frame_name"].default == "gripper_frame_link"
    assert all(each.kind is inspect.Parameter.KEYWORD_ONLY for each in list(made.values())[3:])
    assert list(inspect.signature(RobotKinematics.forward_kinematics).parameters) == ["self", "joint_pos_deg"]
    inverse = inspect.signature(RobotKinematics.inverse_kinematics).parameters
    assert list(inverse)[1:] == ["current_joint_pos", "desired_ee_pose", "position_weight", "orientation_weight"]
    assert [inverse[name].default for name in list(inverse)[3:]] == [1.0, 0.01]


def test_forward_kinematics_is_pinocchio_s(arm, rng):
    assert arm.joint_names == MOTORS
    for _ in range(5):
        q = rng.uniform(-90, 90, 6)
        T = arm.forward_kinematics(q)
        assert T.shape == (4, 4)
        np.testing.assert_allclose(T, pinocchio_pose(q), rtol=0, atol=1e-12)
        np.testing.assert_array_equal(arm.forward_kinematics(np.append(q, [7.0, 8.0])), T)


def test_the_order_is_that_of_the_names_and_not_of_the_arm(rng):
    names = ["gripper", "wrist_roll", "shoulder_pan", "elbow_flex", "shoulder_lift", "wrist_flex"]
    order = [MOTORS.index(name) for name in names]
    mixed, plain = RobotKinematics(ARM, joint_names=names), RobotKinematics(ARM)
    q = rng.uniform(-60, 60, 6)
    np.testing.assert_array_equal(mixed.forward_kinematics(q[order]), plain.forward_kinematics(q))
    T = plain.forward_kinematics(q + rng.normal(0, 5, 6))
    np.testing.assert_array_equal(mixed.inverse_kinematics(q[order], T), plain.inverse_kinematics(q, T)[order])


def test_a_pose_that_the_arm_has_is_reached_in_position_and_orientation(arm, rng):
    for q in smooth_path(rng, 12):
        start = np.append(q + rng.normal(0, 3, 5), 37.5)
        T = arm.forward_kinematics(np.append(q, 0.0))
        answer = arm.inverse_kinematics(start, T)
        np.testing.assert_allclose(arm.forward_kinematics(answer), T, rtol=0, atol=2e-6)
        assert answer[5] == 37.5


def test_position_comes_first_and_orientation_as_far_as_five_joints_go(arm, rng):
    """No configuration that keeps the position has a smaller angle to the orientation, to first order."""
    for q in smooth_path(rng, 12):
        T = arm.forward_kinematics(np.append(q, 0.0))
        T[:3, :3] = T[:3, :3] @ pin.exp3(rng.normal(0, 0.3, 3))
        answer = np.append(q, 0.0)
        for _ in range(20):
            answer = arm.inverse_kinematics(answer, T)
        reached = arm.forward_kinematics(answer)
        angle = np.linalg.norm(pin.log3(reached[:3, :3].T @ T[:3, :3]))
        inside = np.abs(np.radians(answer[:5])) < LIMITS - 1e-9
        if not inside.all():
            continue
        np.testing.assert_allclose(reached[:3, 3], T[:3, 3], rtol=0, atol=2e-6)
        assert angle > 1e-3
        J = arm.robot.jacobian(np.radians(answer[:5]))
        free = np.linalg.svd(J[:3])[2][3:].T
        gradient = free.T @ J[3:].T @ (reached[:3, :3] @ pin.log3(reached[:3, :3].T @ T[:3, :3]))
        np.testing.assert_allclose(gradient, 0, atol=1e-4)


def test_weights_of_zero_leave_out_what_they_weigh(arm, rng):
    for q in smooth_path(rng, 6):
        start = np.append(q + rng.normal(0, 3, 5), 0.0)
        T = arm.forward_kinematics(np.append(q, 0.0))
        turned = T.copy()
        turned[:3, :3] = T[:3, :3] @ pin.exp3(np.array([0.0, 0.4, 0.0]))
        by_position = arm.inverse_kinematics(start, turned, orientation_weight=0.0)
        np.testing.assert_array_equal(by_position, arm.inverse_kinematics(start, T, 1.0, 0.0))
        np.testing.assert_allclose(arm.forward_kinematics(by_position)[:3, 3], T[:3, 3], rtol=0, atol=2e-6)
        by_orientation = arm.inverse_kinematics(start, T, position_weight=0.0)
        np.testing.assert_allclose(arm.forward_kinematics(by_orientation)[:3, :3], T[:3, :3], rtol=0, atol=2e-6)
        np.testing.assert_array_equal(arm.inverse_kinematics(start, T, 5.0, 0.9), arm.inverse_kinematics(start, T))


def test_a_path_is_followed_without_a_jump(arm, rng):
    """In LeRobot's loop, from poses as numbers; the arm that made the path moves no slower."""
    pipeline = Pipeline(arm)
    for _ in range(4):
        path = smooth_path(rng)
        motors = dict(zip((f"{name}.pos" for name in MOTORS), np.append(path[0], 42.0), strict=True))
        largest = 0.0
        for q in path[1:]:
            wanted = dict(zip(motors, np.append(q, 0.0), strict=True))
            position, rotation = pipeline.pose(wanted)
            answer = pipeline.action(motors, position, rotation)
            largest = max(largest, *(abs(answer[key] - motors[key]) for key in motors))
            assert answer["gripper.pos"] == 42.0
            np.testing.assert_allclose(pipeline.pose(answer)[0], position, rtol=0, atol=5e-6)
            motors = answer
        assert largest < 3 * np.abs(np.diff(path, axis=0)).max()


def test_targets_out_of_reach_never_make_it_jump(arm, rng):
    """Far beyond the reach, behind the limits, straight above: at most `max_step` per call, within the limits."""
    pipeline = Pipeline(arm)
    limits = np.degrees(np.append(arm.robot.upper, np.inf))
    motors = dict(zip((f"{name}.pos" for name in MOTORS), START, strict=True))
    for k in range(300):
        a = 2 * np.pi * k / 100
        position = np.array([0.2 + 0.7 * np.sin(a), 0.6 * np.sin(2 * a), 0.3 + 0.4 * np.cos(a)])
        answer = pipeline.action(motors, position, rng.normal(0, 1, 3))
        steps = np.array([answer[key] - motors[key] for key in motors])
        assert np.abs(steps).max() <= 30.0 + 1e-9
        assert (np.abs(list(answer.values())) <= limits).all()
        motors = answer


def test_without_a_largest_step_a_far_pose_is_reached_in_one_call(arm):
    far = arm.forward_kinematics(np.array([80.0, 30.0, -20.0, 10.0, 60.0, 0.0]))
    free = RobotKinematics(ARM, max_step=None)
    np.testing.assert_allclose(
        free.forward_kinematics(free.inverse_kinematics(START, far))[:3, 3], far[:3, 3], atol=5e-6
    )
    q = START
    for _ in range(10):
        q = arm.inverse_kinematics(q, far)
    np.testing.assert_allclose(arm.forward_kinematics(q)[:3, 3], far[:3, 3], rtol=0, atol=5e-6)


def test_a_start_outside_the_limits_comes_back(arm):
    """Motors that are calibrated badly, or turned by hand."""
    start = np.array([140.0, -120.0, 99.0, 0.0, 400.0, 55.0])
    T = arm.forward_kinematics(np.array([80.0, -30.0, 60.0, 20.0, 10.0, 0.0]))
    answer = arm.inverse_kinematics(start, T)
    assert (np.abs(np.radians(answer[:5])) <= LIMITS + 1e-12).all()
    for _ in range(20):
        answer = arm.inverse_kinematics(answer, T)
    np.testing.assert_allclose(arm.forward_kinematics(answer)[:3, 3], T[:3, 3], rtol=0, atol=5e-6)


@pytest.mark.parametrize("kind", [np.float64, np.float32, np.int64])
def test_shapes_and_types_of_arrays(kind):
    """Values beyond those that are named are passed on; an answer with them has the type of what was given."""
    arm = RobotKinematics(ARM, joint_names=MOTORS[:5])
    T = arm.forward_kinematics(START)
    given = START.astype(kind)
    before = given.copy()
    longer, own = arm.inverse_kinematics(given, T), arm.inverse_kinematics(given[:5], T)
    assert longer.shape == (6,)
    assert own.shape == (5,)
    assert longer.dtype == (float if kind is np.int64 else kind)
    assert own.dtype == float
    assert longer[5] == 42
    np.testing.assert_allclose(longer[:5], own, rtol=1e-6)
    np.testing.assert_array_equal(given, before)
    assert arm.inverse_kinematics(START.tolist(), T.tolist()).shape == (6,)


def test_joints_that_are_left_out_stand_still():
    arm = RobotKinematics(ARM, joint_names=["shoulder_pan", "elbow_flex"])
    q = np.array([20.0, 30.0])
    np.testing.assert_allclose(
        arm.forward_kinematics(q), pinocchio_pose(np.array([20.0, 0, 30.0, 0, 0, 0])), rtol=0, atol=1e-12
    )
    answer = arm.inverse_kinematics(q, arm.forward_kinematics(np.array([25.0, 22.0])))
    np.testing.assert_allclose(answer, [25.0, 22.0], atol=1e-3)


def test_it_pickles(arm):
    again = pickle.loads(pickle.dumps(arm))
    T = arm.forward_kinematics(START + 3)
    np.testing.assert_array_equal(again.inverse_kinematics(START, T), arm.inverse_kinematics(START, T))


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda a: RobotKinematics(ARM, "gripper"), FrameError, "gripper_link"),
        (
            lambda a: RobotKinematics(ARM, joint_names=["shoulder_pan", "elbow"]),
            OptionError,
            "did you mean 'elbow_flex'",
        ),
        (lambda a: RobotKinematics(ARM, joint_names=["wrist_roll", "wrist_roll"]), OptionError, "named twice"),
        (lambda a: RobotKinematics(ARM, max_step=0), OptionError, "max_step"),
        (lambda a: RobotKinematics("no such file.urdf"), (RobotError, OSError), "no such file"),
        (lambda a: a.forward_kinematics(START[:5]), ConfigurationError, "at least 6"),
        (lambda a: a.inverse_kinematics(START[None], np.eye(4)), ConfigurationError, "at least 6"),
        (lambda a: a.inverse_kinematics(START * np.nan, np.eye(4)), ConfigurationError, "current_joint_pos"),
        (lambda a: a.inverse_kinematics(START, np.full((4, 4), np.nan)), PoseError, "desired_ee_pose"),
        (lambda a: a.inverse_kinematics(START, np.eye(4), orientation_weight=-1), OptionError, "orientation_weight"),
    ],
)
def test_mistakes_name_what_is_valid(arm, call, error, message):
    with pytest.raises(error, match=message):
        call(arm)
