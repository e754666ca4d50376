"""Arcs, circles and spirals against their equations."""

import itertools

import numpy as np
import pytest
from scipy.integrate import quad
from support.paths import distances, random_pose, random_poses, rotation_angles

import maira_qp as mq
from maira_qp import paths
from maira_qp.errors import OptionError, PoseError


def test_an_arc_is_on_one_circle_and_goes_through_its_three_poses(rng):
    for _ in range(30):
        poses = random_poses(rng, 3)
        path = paths.arc(*poses, step=0.01, turn=0.1)
        at = np.abs(path[:, None] - poses).max(axis=(2, 3))
        assert at.min(axis=0).max() < 1e-12
        assert at.argmin(axis=0)[0] == 0 < at.argmin(axis=0)[1] < len(path) - 1 == at.argmin(axis=0)[2]
        p, q = path[:, :3, 3], poses[:, :3, 3]
        # the centre as the solution of linear equations: in the plane, as far from each of the three
        normal = np.cross(q[1] - q[0], q[2] - q[0])
        rows = np.array([q[1] - q[0], q[2] - q[0], normal / np.linalg.norm(normal)])
        sides = [(q[1] @ q[1] - q[0] @ q[0]) / 2, (q[2] @ q[2] - q[0] @ q[0]) / 2, rows[2] @ q[0]]
        center = np.linalg.solve(rows, sides)
        radius = np.linalg.norm(q[0] - center)
        scale = max(1.0, radius) * np.linalg.cond(rows)
        assert np.abs(np.linalg.norm(p - center, axis=1) - radius).max() < 1e-14 * scale * 10
        assert np.abs((p - center) @ rows[2]).max() < 1e-14 * scale * 10
        assert distances(path).max() <= 0.01 * (1 + 1e-9)
        assert rotation_angles(path).max() <= 0.1 * (1 + 1e-9)


def test_an_arc_runs_one_way_round():
    corner = [mq.pose([np.cos(a), np.sin(a), 0]) for a in (0.0, 4.0, 6.0)]
    path = paths.arc(*corner)
    np.testing.assert_allclose(np.linalg.norm(path[:, :3, 3], axis=1), 1.0, atol=1e-12)
    angle = np.unwrap(np.arctan2(path[:, 1, 3], path[:, 0, 3]))
    assert (np.diff(angle) > 0).all()
    np.testing.assert_allclose(angle[-1], 6.0, atol=1e-12)


def test_an_arc_that_is_nearly_a_line_is_nearly_that_line():
    for bend in (1e-3, 1e-5, 1e-7):
        path = paths.arc(mq.pose(), mq.pose([0.5, bend, 0]), mq.pose([1.0, 0, 0]))
        x, y = path[:, 0, 3], path[:, 1, 3]
        np.testing.assert_allclose(y, 4 * bend * x * (1 - x), atol=10 * bend**2 + 1e-12)
    with pytest.raises(PoseError, match="line or polyline"):
        paths.arc(mq.pose(), mq.pose([0.5, 1e-10, 0]), mq.pose([1.0, 0, 0]))


@pytest.mark.parametrize("tangent", [False, True])
@pytest.mark.parametrize("turns", [1.0, -2.0, 0.3])
def test_a_circle_is_round_and_even(rng, tangent, turns):
    center, begin = random_pose(rng), 0.7
    path = paths.circle(center, 0.3, turns=turns, start_angle=begin, tangent=tangent)
    local = np.linalg.inv(center.homogeneous) @ path
    x, y, z = local[:, :3, 3].T
    np.testing.assert_allclose(np.hypot(x, y), 0.3, atol=1e-12)
    np.testing.assert_allclose(z, 0.0, atol=1e-12)
    angle = np.unwrap(np.arctan2(y, x))
    np.testing.assert_allclose(angle, begin + 2 * np.pi * turns * np.linspace(0, 1, len(path)), atol=1e-11)
    assert distances(path).max() <= 0.005 * (1 + 1e-9)
    assert len(path) - 1 == np.ceil(2 * np.pi * abs(turns) * 0.3 / 0.005)
    if tangent:
        moving = np.gradient(local[:, :3, 3], axis=0)
        moving /= np.linalg.norm(moving, axis=1)[:, None]
        np.testing.assert_allclose(local[1:-1, :3, 0], moving[1:-1], atol=1e-9)
        np.testing.assert_allclose(local[:, 2, 2], 1.0, atol=1e-12)
        assert rotation_angles(path).max() <= 0.05 * (1 + 1e-9)
    else:
        np.testing.assert_allclose(local[:, :3, :3], np.broadcast_to(np.eye(3), (len(path), 3, 3)), atol=1e-12)


def test_a_small_circle_is_round_too():
    path = paths.circle(mq.pose(), 1e-3)
    assert len(path) - 1 == np.ceil(2 * np.pi / 0.05)


@pytest.mark.parametrize(("first", "last", "pitch"), [(0.0, 0.3, 0.0), (0.3, 0.1, 0.05), (0.2, 0.2, -0.1)])
@pytest.mark.parametrize("turns", [3.5, -2.0])
def test_a_spiral_is_archimedean_and_even_along_its_length(rng, first, last, pitch, turns):
    center = random_pose(rng)
    path = paths.spiral(center, first, last, turns=turns, pitch=pitch, step=0.004, turn=np.inf)
    local = np.linalg.inv(center.homogeneous) @ path
    x, y, z = local[:, :3, 3].T
    radius = np.hypot(x, y)
    u = z / (pitch * abs(turns)) if pitch else (radius - first) / (last - first)
    np.testing.assert_allclose(radius, first + (last - first) * u, atol=1e-12)
    swept = 2 * np.pi * turns
    np.testing.assert_allclose(x, radius * np.cos(swept * u), atol=1e-10)
    np.testing.assert_allclose(y, radius * np.sin(swept * u), atol=1e-10)
    np.testing.assert_allclose(u[[0, -1]], [0.0, 1.0], atol=1e-12)

    def speed(s):
        return np.sqrt((swept * (first + (last - first) * s)) ** 2 + (last - first) ** 2 + (pitch * turns) ** 2)

    arcs = np.array([quad(speed, a, b)[0] for a, b in itertools.pairwise(u)])
    assert arcs.max() <= 0.004 * (1 + 1e-9)
    assert arcs[3:].min() >= 0.99 * arcs.max()
    assert len(arcs) <= 1.002 * quad(speed, 0, 1)[0] / 0.004 + 2


def test_near_the_middle_of_a_spiral_the_angle_decides():
    path = paths.spiral(mq.pose(), 0.0, 0.1, turns=10, tangent=True)
    assert rotation_angles(path).max() <= 0.05 * (1 + 1e-9)
    assert distances(path).max() <= 0.005 * (1 + 1e-9)


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda T, A, B: paths.arc(T, A, T), PoseError, "three positions"),
        (lambda T, A, B: paths.arc(T, T, A), PoseError, "three positions"),
        (lambda T, A, B: paths.arc(T, A, B), PoseError, "line or polyline"),
        (lambda T, A, B: paths.arc(A, T, B), PoseError, "line or polyline"),
        (lambda T, A, B: paths.circle(T, 0), OptionError, "radius must be a positive number"),
        (lambda T, A, B: paths.circle(T, -0.1), OptionError, "radius must be a positive number"),
        (lambda T, A, B: paths.circle(T, np.nan), OptionError, "radius must be a number"),
        (lambda T, A, B: paths.circle(T, 0.1, turns=0), OptionError, "turns must not be 0"),
        (lambda T, A, B: paths.circle(T, 0.1, tangent="yes"), OptionError, "tangent must be True or False"),
        (lambda T, A, B: paths.circle(T, 0.1, start_angle=None), OptionError, "start_angle must be a number"),
        (lambda T, A, B: paths.spiral(T, 0, 0), OptionError, "both radii"),
        (lambda T, A, B: paths.spiral(T, -0.1, 0.1), OptionError, "start_radius must be a number"),
        (lambda T, A, B: paths.spiral(T, 0, 0.1, pitch=np.inf), OptionError, "pitch must be a number"),
        (lambda T, A, B: paths.circle(np.full((4, 4), np.nan), 0.1), PoseError, "center must be finite"),
    ],
)
def test_what_makes_no_curve_is_named(call, error, message):
    with pytest.raises(error, match=message):
        call(mq.pose(), mq.pose([0.1, 0.1, 0]), mq.pose([0.3, 0.3, 0]))


def test_rotations_stay_rotations(rng):
    poses = random_poses(rng, 6)
    for path in (
        paths.polyline(poses, blend=0.05, frame=random_pose(rng)),
        paths.arc(*poses[:3], frame=random_pose(rng)),
        paths.circle(poses[0], 0.2, tangent=True, frame=random_pose(rng)),
        paths.resampled(poses, frame=random_pose(rng)),
        paths.cube(poses[0], 0.2, frame=random_pose(rng)),
    ):
        R = path[:, :3, :3]
        assert np.abs(R @ R.swapaxes(1, 2) - np.eye(3)).max() < 1e-14
        assert (np.linalg.det(R) > 0).all()
        np.testing.assert_array_equal(path[:, 3], np.tile([0, 0, 0, 1.0], (len(path), 1)))


def test_a_frame_multiplies_from_the_left(rng):
    A, B, C = random_poses(rng, 3)
    frame = random_pose(rng)
    for make in (
        lambda **frame: paths.line(A, B, **frame),
        lambda **frame: paths.arc(A, B, C, **frame),
        lambda **frame: paths.polyline([A, B, C], blend=0.01, **frame),
        lambda **frame: paths.circle(A, 0.1, **frame),
        lambda **frame: paths.spiral(A, 0.1, 0.2, **frame),
        lambda **frame: paths.rectangle(A, 0.1, 0.2, **frame),
        lambda **frame: paths.cube(A, 0.1, **frame),
        lambda **frame: paths.letters("A1", 0.1, A, **frame),
        lambda **frame: paths.resampled([A, B], **frame),
        lambda **frame: paths.waypoints([A, B], 0.1, **frame),
        lambda **frame: paths.waypoints([A, B], 0.1, times=[0, 1], **frame),
    ):
        alone = make()
        np.testing.assert_allclose(make(frame=frame), frame.homogeneous @ alone, atol=1e-12)
        np.testing.assert_allclose(make(frame=frame.homogeneous), paths.in_frame(alone, frame), atol=1e-12)
        assert isinstance(alone, np.ndarray)
        assert not np.allclose(alone, frame.homogeneous @ alone)
