"""Straight lines, corners and what is made of them."""

import itertools

import numpy as np
import pinocchio as pin
import pytest
from support.paths import distances, random_pose, random_poses, rotation_angles

import maira_qp as mq
from maira_qp import paths
from maira_qp.errors import OptionError, PoseError


@pytest.mark.parametrize(("step", "turn"), [(0.005, 0.05), (0.3, 0.01), (np.inf, 0.2), (0.01, np.inf)])
def test_a_line_hits_its_ends_and_no_neighbours_are_too_far_apart(rng, step, turn):
    for _ in range(20):
        start, end = random_pose(rng), random_pose(rng)
        path = paths.line(start, end, step=step, turn=turn)
        np.testing.assert_allclose(path[[0, -1]], [start.homogeneous, end.homogeneous], atol=1e-12)
        assert distances(path).max() <= step * (1 + 1e-9)
        assert rotation_angles(path).max() <= turn * (1 + 1e-9)
        fewest = max(
            np.linalg.norm(end.translation - start.translation) / step,
            np.linalg.norm(pin.log3(start.rotation.T @ end.rotation)) / turn,
        )
        assert len(path) - 1 == np.ceil(fewest * (1 - 1e-9))


def test_the_orientation_of_a_line_is_a_slerp(rng):
    """Against Eigen's slerp of quaternions, the positions at even parts of the way."""
    for angle in (1e-9, 1e-3, 1.0, 3.0, np.pi - 1e-6):
        start = random_pose(rng)
        axis = pin.log3(random_pose(rng).rotation)
        way = pin.SE3(pin.exp3(angle * axis / np.linalg.norm(axis)), rng.normal(size=3))
        end = start * way
        path = paths.line(start, end, turn=0.1)
        first, last = pin.Quaternion(start.rotation), pin.Quaternion(end.rotation)
        for u, T in zip(np.linspace(0, 1, len(path)), path, strict=True):
            np.testing.assert_allclose(T[:3, :3], first.slerp(u, last).toRotationMatrix(), atol=1e-9)
            np.testing.assert_allclose(T[:3, 3], (1 - u) * start.translation + u * end.translation, atol=1e-12)


def test_half_a_turn_is_made_about_one_of_its_axes(rng):
    start = random_pose(rng)
    end = start * pin.SE3(pin.exp3(np.array([0.0, np.pi, 0.0])), np.zeros(3))
    path = paths.line(start, end)
    np.testing.assert_allclose(path[-1], end.homogeneous, atol=1e-12)
    assert rotation_angles(path).max() <= 0.05 * (1 + 1e-9)
    np.testing.assert_allclose(rotation_angles(path).sum(), np.pi, rtol=1e-9)


def test_a_line_from_a_pose_to_itself_is_that_pose(rng):
    start = random_pose(rng)
    np.testing.assert_allclose(paths.line(start, start), [start.homogeneous], atol=1e-15)


def test_a_polyline_without_blends_goes_through_every_pose(rng):
    poses = random_poses(rng, 12)
    repeated = np.repeat(poses, rng.integers(1, 4, len(poses)), axis=0)
    path = paths.polyline(repeated, step=0.02, turn=0.1)
    np.testing.assert_array_equal(path, paths.polyline(poses, step=0.02, turn=0.1))
    off = np.abs(path[:, None] - poses).max(axis=(2, 3))
    assert off.min(axis=0).max() < 1e-12
    assert (np.diff(off.argmin(axis=0)) > 0).all()
    assert (distances(path) > 1e-9).all()
    assert distances(path).max() <= 0.02 * (1 + 1e-9)
    assert rotation_angles(path).max() <= 0.1 * (1 + 1e-9)


def test_blends_are_smooth_in_position_and_orientation(rng):
    """Twist per pose changes by as little as the sampling is fine, in the blends and where they begin and end."""
    poses = random_poses(rng, 6, spread=0.5)
    jumps = []
    for fine in (1.0, 0.25):
        path = paths.polyline(poses, blend=0.09, step=0.002 * fine, turn=0.01 * fine)
        twists = np.array([pin.log6(pin.SE3(A).inverse() * pin.SE3(B)).vector for A, B in itertools.pairwise(path)])
        # the path has no time of its own: directions are compared, of the motion in metres and radians together
        unit = twists / np.linalg.norm(twists, axis=1)[:, None]
        jumps.append(np.linalg.norm(np.diff(unit, axis=0), axis=1).max())
        assert rotation_angles(path).max() <= 0.01 * fine * (1 + 1e-9)
        assert distances(path).max() <= 0.002 * fine * (1 + 1e-9)
    sharp = paths.polyline(poses, step=0.002, turn=0.01)
    twists = np.diff(sharp[:, :3, 3], axis=0)
    unit = twists / np.linalg.norm(twists, axis=1)[:, None]
    assert np.linalg.norm(np.diff(unit, axis=0), axis=1).max() > 0.3  # what a corner looks like
    assert jumps[1] < 0.35 * jumps[0]
    assert jumps[1] < 0.1


def test_blends_stay_near_their_corners(rng):
    poses, blend = random_poses(rng, 10, spread=0.5), 0.08
    path = paths.polyline(poses, blend=blend, step=0.001, turn=1.0)
    p, corners = path[:, :3, 3], poses[:, :3, 3]
    legs = np.diff(corners, axis=0)
    part = np.einsum("mki,ki->mk", p[:, None] - corners[:-1], legs) / np.einsum("ki,ki->k", legs, legs)
    foot = corners[:-1] + np.clip(part, 0, 1)[..., None] * legs
    off_the_legs = np.linalg.norm(p[:, None] - foot, axis=2).min(axis=1) > 1e-9
    to_corner = np.linalg.norm(p[:, None] - corners[1:-1], axis=2).min(axis=1)
    assert off_the_legs.any()
    assert to_corner[off_the_legs].max() <= blend * (1 + 1e-9)
    assert (np.linalg.norm(p[:, None] - corners[1:-1], axis=2).min(axis=0) > 0.1 * blend).sum() >= 6  # corners are cut
    np.testing.assert_allclose(path[[0, -1]], poses[[0, -1]], atol=1e-12)


def test_a_blend_that_does_not_fit_is_named_with_the_largest_that_does():
    corners = [mq.pose([0, 0, 0]), mq.pose([0.1, 0, 0]), mq.pose([0.1, 0.06, 0]), mq.pose([0.3, 0.06, 0])]
    with pytest.raises(OptionError, match=r"leg 1, 0\.06 m long: at most 0\.03 m"):
        paths.polyline(corners, blend=0.05)
    path = paths.polyline(corners, blend=0.03)
    np.testing.assert_allclose(path[-1], corners[-1].homogeneous, atol=1e-12)


def test_where_the_tool_turns_on_the_spot_there_is_no_blend():
    corners = [mq.pose([0, 0, 0]), mq.pose([0.1, 0, 0]), mq.pose([0.1, 0, 0], rpy=[0, 0, 1]), mq.pose([0.1, 0.1, 0])]
    path = paths.polyline(corners, blend=0.02)
    off = np.abs(path[:, None] - [T.homogeneous for T in corners]).max(axis=(2, 3)).min(axis=0)
    assert off.max() < 1e-12
    assert rotation_angles(path).max() <= 0.05 * (1 + 1e-9)


def test_blends_turn_no_faster_than_lines(rng):
    """Where the rotation decides alone, at angles up to half a turn a leg."""
    for _ in range(10):
        poses = random_poses(rng, 4, spread=1.0)
        blend = 0.4 * distances(poses).min()
        path = paths.polyline(poses, blend=blend, step=np.inf, turn=0.05)
        assert rotation_angles(path).max() <= 0.05 * (1 + 1e-9)


def test_a_rectangle_lies_in_its_plane_and_has_its_sides(rng):
    center = random_pose(rng)
    path = paths.rectangle(center, 0.3, 0.2, step=0.01)
    local = np.linalg.inv(center.homogeneous) @ path
    np.testing.assert_allclose(local[:, :3, :3], np.broadcast_to(np.eye(3), (len(path), 3, 3)), atol=1e-12)
    x, y, z = local[:, :3, 3].T
    assert np.abs(z).max() < 1e-12
    np.testing.assert_allclose(np.maximum(np.abs(x) / 0.15, np.abs(y) / 0.1), 1.0, atol=1e-12)
    np.testing.assert_allclose(distances(path).sum(), 1.0, atol=1e-12)
    np.testing.assert_allclose(path[0], path[-1], atol=1e-12)
    angle = np.unwrap(np.arctan2(y, x))
    np.testing.assert_allclose(angle[-1] - angle[0], 2 * np.pi, atol=1e-12)


def test_a_square_is_rounded_at_all_four_corners():
    path = paths.square(mq.pose(), 0.2, blend=0.05, step=0.001)
    corner = np.abs(path[:, :2, 3]).min(axis=1).max()
    np.testing.assert_allclose(corner, 0.1 - 0.05 / 4, atol=1e-6)  # a parabola's apex is half of the way to the corner
    for x in (-1, 1):
        for y in (-1, 1):
            off = np.linalg.norm(path[:, :2, 3] - 0.1 * np.array([x, y]), axis=1).min()
            np.testing.assert_allclose(off, 0.05 / 2 / np.sqrt(2), rtol=1e-3)


def test_a_cube_runs_along_each_of_its_edges(rng):
    center, edge = random_pose(rng), 0.2
    path = paths.cube(center, edge, tilt=0.4)
    local = np.linalg.inv(center.homogeneous) @ path
    p = local[:, :3, 3] / (edge / 2)
    fixed = np.isclose(np.abs(p), 1.0, atol=1e-9)
    assert (fixed.sum(axis=1) >= 2).all()
    middle = np.isclose(p, 0.0, atol=0.1).any(axis=1)
    edges = {tuple(np.where(np.isclose(np.abs(each), 1.0), np.sign(each), 0.0)) for each in p[middle]}
    assert len(edges) == 12
    at_corner = fixed.all(axis=1)
    tilts = [np.linalg.norm(pin.log3(R)) for R in local[at_corner, :3, :3]]
    np.testing.assert_allclose(tilts, 0.4, atol=1e-9)
    assert rotation_angles(path).max() > 0.001


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda T: paths.line(T, T, step=-1), OptionError, "step must be a positive number"),
        (lambda T: paths.line(T, T, step=0), OptionError, "step must be a positive number"),
        (lambda T: paths.line(T, T, turn=np.nan), OptionError, "turn must be a positive number"),
        (lambda T: paths.line(T, mq.pose([1, 0, 0]), step=1e-12), OptionError, "choose larger"),
        (lambda T: paths.line(T, np.full((4, 4), np.nan)), PoseError, "end must be finite"),
        (lambda T: paths.line(np.diag([1, 1, -1, 1]), T), PoseError, "reflection"),
        (lambda T: paths.line(T, mq.pose([1e200, 0, 0])), PoseError, "the end is 1e\\+200 m away"),
        (lambda T: paths.polyline([]), PoseError, "at least 1 pose"),
        (lambda T: paths.polyline(T), PoseError, "a sequence of poses"),
        (lambda T: paths.polyline([T, 2 * np.eye(4)]), PoseError, "pose 1"),
        (lambda T: paths.polyline([T, T], blend=-0.1), OptionError, "blend must be a number of metres from 0"),
        (lambda T: paths.rectangle(T, 0.1, 0), OptionError, "height must be a positive number"),
        (lambda T: paths.square(T, np.inf), OptionError, "side must be a number"),
        (lambda T: paths.cube(T, 0.1, tilt="0.1"), OptionError, "tilt must be a number"),
        (lambda T: paths.line(T, T, frame=[1, 2, 3]), PoseError, "frame"),
    ],
)
def test_what_makes_no_line_is_named(call, error, message):
    with pytest.raises(error, match=message):
        call(mq.pose())
