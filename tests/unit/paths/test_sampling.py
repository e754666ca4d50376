"""Resampling, length and frames."""

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial import KDTree
from support.paths import distances, random_pose, random_poses, rotation_angles

import maira_qp as mq
from maira_qp import paths
from maira_qp.errors import OptionError, PoseError


@pytest.mark.parametrize(("step", "turn"), [(0.01, np.inf), (0.01, 0.02), (np.inf, 0.05), (0.5, 5.0)])
def test_a_resampled_path_stays_near_the_path_and_keeps_its_ends(rng, step, turn):
    poses = random_poses(rng, 9, spread=0.3)
    path = paths.resampled(poses, step=step, turn=turn)
    np.testing.assert_allclose(path[[0, -1]], poses[[0, -1]], atol=1e-12)
    assert distances(path).max() <= step * (1 + 1e-9)
    assert rotation_angles(path).max() <= turn * (1 + 1e-9)
    dense = paths.polyline(poses, step=1e-3, turn=0.1)[:, :3, 3]
    off_the_path, _ = KDTree(dense).query(path[:, :3, 3])
    assert off_the_path.max() <= 1e-3
    if step < 0.1:  # nothing of the path is far from a new pose
        assert KDTree(path[:, :3, 3]).query(dense)[0].max() <= step / 2 + 1e-3


def test_poses_are_evenly_spaced_along_the_length():
    """On a quarter of a circle, given unevenly, against its arc length."""
    angle = np.pi / 2 * np.linspace(0, 1, 4000) ** 3
    poses = np.tile(np.eye(4), (4000, 1, 1))
    poses[:, 0, 3], poses[:, 1, 3] = np.cos(angle), np.sin(angle)
    path = paths.resampled(poses, step=0.01)
    found = np.arctan2(path[:, 1, 3], path[:, 0, 3])
    np.testing.assert_allclose(found, np.linspace(0, np.pi / 2, len(path)), atol=1e-5)
    np.testing.assert_allclose(paths.length(poses), np.pi / 2, atol=1e-6)


def test_repeated_poses_do_not_matter(rng):
    poses = random_poses(rng, 7)
    repeated = np.repeat(poses, rng.integers(1, 5, 7), axis=0)
    np.testing.assert_allclose(paths.resampled(repeated), paths.resampled(poses), atol=1e-12)
    joined = np.concatenate([paths.line(poses[0], poses[1]), paths.line(poses[1], poses[2])])
    assert (distances(paths.resampled(joined)) > 1e-4).all()
    np.testing.assert_allclose(paths.resampled(np.repeat(poses[:1], 5, axis=0)), poses[:1], atol=1e-12)


def test_poses_that_repeat_to_rounding_are_repeated(rng):
    """As where paths are joined that came from two frames; the end that was given is the end."""
    poses = random_poses(rng, 3)
    nearly = poses[[0, 1, 1, 2, 2]].copy()
    nearly[[2, 4], :3, 3] += 5e-13
    for make in (paths.polyline, paths.resampled, lambda each: paths.waypoints(each, 0.1, stop=False)):
        path = make(nearly)
        assert len(path) == len(make(poses))
        assert distances(path).min() > 1e-4
        np.testing.assert_allclose(path[-1], nearly[-1], rtol=0, atol=2e-15)


def test_a_path_may_be_poses_of_pinocchio_or_a_list_of_arrays(rng):
    poses = [random_pose(rng) for _ in range(4)]
    arrays = np.array([T.homogeneous for T in poses])
    for given in (poses, tuple(poses), [poses[0], *arrays[1:]], arrays.tolist()):
        np.testing.assert_array_equal(paths.resampled(given), paths.resampled(arrays))


def test_one_pose_is_one_pose():
    path = paths.resampled([mq.pose([1, 2, 3])])
    np.testing.assert_allclose(path, [mq.pose([1, 2, 3]).homogeneous])
    assert paths.length(path) == 0.0


def test_rounded_rotations_are_made_exact(rng):
    poses = random_poses(rng, 3)
    path = paths.resampled(poses.astype(np.float32))
    R = path[:, :3, :3]
    assert np.abs(R @ R.swapaxes(1, 2) - np.eye(3)).max() < 1e-14


@pytest.mark.parametrize(
    ("poses", "message"),
    [
        ([], "at least 1 pose needed, got 0"),
        (mq.pose(), "a sequence of poses"),
        (np.eye(4), "a sequence of poses"),
        (None, "a sequence of poses"),
        ("path.csv", "a sequence of poses"),
        ([np.eye(4), np.full((4, 4), np.nan)], "pose 1 holds NaN"),
        ([np.eye(4), np.diag([1.0, 1, -1, 1])], "pose 1 has a negative determinant"),
        ([np.eye(4), np.diag([1.0, 2, 1, 1])], "pose 1 is not orthonormal"),
        ([np.eye(4), np.eye(3)], "pose 1 must be a pose"),
        ([np.eye(4), mq.pose([0, 1e10, 0])], "pose 1 is 1e\\+10 m away"),
    ],
)
def test_what_is_no_path_is_named(poses, message):
    for verb in (paths.resampled, paths.length, paths.polyline, lambda each: paths.waypoints(each, 0.1)):
        with pytest.raises(PoseError, match=message):
            verb(poses)


def test_a_step_that_makes_too_many_poses_is_refused(rng):
    with pytest.raises(OptionError, match="choose larger"):
        paths.resampled(random_poses(rng, 3), step=1e-9)


def test_in_frame_is_a_product(rng):
    frame, poses = random_pose(rng), [random_pose(rng) for _ in range(5)]
    moved = paths.in_frame(poses, frame)
    for T, each in zip(moved, poses, strict=True):
        np.testing.assert_allclose(T, (frame * each).homogeneous, atol=1e-12)
    with pytest.raises(PoseError, match="frame must be"):
        paths.in_frame(poses, pin.exp3(np.ones(3)))
