"""Targets: what is accepted, what is refused, and what the error says."""

import numpy as np
import pinocchio as pin
import pytest

import maira_qp as mq
from maira_qp.errors import PoseError
from maira_qp.problem.pose import as_pose

ROUNDED = [[0.997, 0.046, -0.063, 0.358], [-0.078, 0.527, -0.847, -0.484], [-0.006, 0.849, 0.528, 0.825], [0, 0, 0, 1]]


def test_a_quaternion_is_scalar_first():
    half = np.sqrt(0.5)
    T = mq.pose([1, 2, 3], quaternion=[half, 0, 0, half])
    assert np.allclose(T.rotation, [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-15)
    assert T.translation.tolist() == [1, 2, 3]


def test_roll_pitch_yaw_follow_urdf():
    r, p, y = 0.3, -0.5, 1.1
    expected = pin.utils.rotate("z", y) @ pin.utils.rotate("y", p) @ pin.utils.rotate("x", r)
    assert np.abs(mq.pose([0, 0, 0], rpy=[r, p, y]).rotation - expected).max() < 1e-15


def test_a_matrix_may_be_3x3_or_4x4(rng):
    T = pin.SE3.Random()
    assert mq.pose(matrix=T.homogeneous).isApprox(T, 1e-14)
    assert mq.pose([1, 2, 3], matrix=T.rotation).isApprox(pin.SE3(T.rotation, np.array([1.0, 2, 3])), 1e-14)


def test_rounding_below_1e_5_is_forgiven_and_gives_an_exact_rotation():
    T = pin.SE3.Random().homogeneous.astype(np.float32)
    R = as_pose(T).rotation
    assert np.abs(R @ R.T - np.eye(3)).max() < 4e-15
    assert np.abs(R - T[:3, :3]).max() < 1e-6


def test_three_decimals_are_taken_as_the_nearest_rotation_and_it_is_logged(caplog, rng):
    """The example of the lecture, and whatever is rounded: 1.8e-3 of a matrix and 1e-3 of a quaternion is the worst."""
    caplog.set_level("INFO")
    T = mq.pose(matrix=ROUNDED)
    assert np.abs(T.rotation @ T.rotation.T - np.eye(3)).max() < 4e-15
    assert np.abs(T.homogeneous - ROUNDED).max() < 2e-3
    assert "the nearest rotation is taken" in caplog.text
    for decimals in (3, 4, 7):
        for _ in range(50):
            R = pin.SE3.Random().rotation
            exact = mq.pose(matrix=np.round(R, decimals)).rotation
            assert np.abs(exact @ exact.T - np.eye(3)).max() < 4e-15
            assert np.abs(exact - R).max() < 10.0**-decimals
            q = rng.normal(size=4)
            q /= np.linalg.norm(q)
            near = mq.pose(quaternion=np.round(q, decimals)).rotation
            assert np.abs(near - mq.pose(quaternion=q).rotation).max() < 4 * 10.0**-decimals


def test_what_is_farther_off_is_refused_with_the_way_out_in_the_language_that_is_spoken():
    off = np.eye(4)
    off[0, 0] = 1.002
    with pytest.raises(PoseError, match=r"not orthonormal.*= 0\.004.*project=True") as reason:
        mq.pose(matrix=off)
    assert "mq." not in reason.value.for_shell
    assert reason.value.for_shell.endswith("--project")
    assert mq.pose(matrix=off, project=True).isIdentity(1e-14)
    with pytest.raises(PoseError, match="project=True") as reason:
        mq.pose(quaternion=[1.003, 0, 0, 0])
    assert reason.value.for_shell.endswith("--project")


@pytest.mark.parametrize("project", [False, True])
def test_a_reflection_is_refused_always(project):
    T = np.diag([1.0, 1.0, -1.0, 1.0])
    with pytest.raises(PoseError, match="negative determinant"):
        mq.pose(matrix=T, project=project)


@pytest.mark.parametrize("scale", [0.0, 1e-300])
@pytest.mark.parametrize("diagonal", [[1, 1, 0], [1, 1e-9, 1e-9], [0, 0, 0]])
def test_a_singular_matrix_has_no_nearest_rotation(diagonal, scale):
    T = np.eye(4)
    T[:3, :3] = np.diag(np.array(diagonal, dtype=float) * (scale or 1.0))
    with pytest.raises(PoseError, match="singular"):
        mq.pose(matrix=T, project=True)


@pytest.mark.parametrize("size", [1e-150, 1e-3, 1e3, 1e200])
def test_projection_takes_the_rotation_out_of_any_scale(size):
    T = pin.SE3.Random()
    assert np.abs(mq.pose([0, 0, 0], matrix=size * T.rotation, project=True).rotation - T.rotation).max() < 1e-14


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"quaternion": [0, 0, 0, 0]}, "quaternion is zero"),
        ({"quaternion": [2, 0, 0, 0]}, "norm is 2"),
        ({"quaternion": [1, 0, 0]}, r"shape \(4,\)"),
        ({"quaternion": [np.nan, 0, 0, 1]}, "finite"),
        ({"quaternion": ["a", 0, 0, 1]}, "real numbers"),
        ({"position": [1, 2]}, r"shape \(3,\)"),
        ({"position": [1, 2, np.inf]}, "finite"),
        ({"position": [1, 2, 3j]}, "real numbers"),
        ({"position": [True, False, True]}, "real numbers"),
        ({"matrix": np.eye(4), "position": [1, 0, 0]}, "holds its own position"),
        ({"matrix": np.ones((2, 2))}, "shape"),
        ({"matrix": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 2]]}, "last row"),
        ({"quaternion": [1, 0, 0, 0], "rpy": [0, 0, 0]}, "one orientation"),
    ],
)
def test_what_is_no_pose_is_refused_with_a_reason(arguments, message):
    with pytest.raises(PoseError, match=message):
        mq.pose(**arguments)


@pytest.mark.parametrize("norm", [1 + 9e-6, 1 - 9e-6])
def test_a_quaternion_unit_to_1e_5_is_made_unit(norm):
    R = mq.pose([0, 0, 0], quaternion=[norm * np.cos(0.2), 0, 0, norm * np.sin(0.2)]).rotation
    assert np.abs(R @ R.T - np.eye(3)).max() < 4e-15


def test_a_pinocchio_pose_that_is_no_rotation_is_refused():
    with pytest.raises(PoseError, match="not orthonormal"):
        as_pose(pin.SE3(1.1 * np.eye(3), np.zeros(3)))


def test_big_endian_and_integer_arrays_mean_the_same():
    T = pin.SE3.Random().homogeneous
    assert np.array_equal(as_pose(T.astype(">f8")).homogeneous, as_pose(T).homogeneous)
    assert np.array_equal(as_pose(np.eye(4, dtype=int)).homogeneous, np.eye(4))


@pytest.mark.parametrize("target", [None, "pose", 3.0, np.zeros((3, 3)), [[1]], object(), {"tool0": np.eye(4)}])
def test_what_is_no_target_is_refused(target):
    with pytest.raises(PoseError):
        as_pose(target)
