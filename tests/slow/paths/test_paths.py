"""Paths of a million poses, and paths of every maker followed by MAIRA."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.paths import distances, random_poses

import maira_qp as mq
from maira_qp import paths

COUNT = 10**6


def about_z(angle: np.ndarray) -> np.ndarray:
    """Rotations (N, 3, 3) by angles (N,) [rad]."""
    return Rotation.from_rotvec(np.outer(angle, [0.0, 0.0, 1.0])).as_matrix()


@pytest.fixture(scope="module")
def screw() -> np.ndarray:
    """(COUNT, 4, 4): 10 m along x, ten turns about z."""
    poses = np.zeros((COUNT, 4, 4))
    poses[:, :3, :3] = about_z(np.linspace(0, 20 * np.pi, COUNT))
    poses[:, 0, 3] = np.linspace(0, 10, COUNT)
    poses[:, 3, 3] = 1.0
    return poses


def check_on_the_screw(path: np.ndarray) -> None:
    np.testing.assert_allclose(path[:, :3, :3], about_z(2 * np.pi * path[:, 0, 3]), atol=1e-6)
    np.testing.assert_allclose(path[:, 1:3, 3], 0.0, atol=1e-12)


def test_a_million_poses_are_resampled(screw):
    path = paths.resampled(screw, step=0.0047)
    assert len(path) == 2129
    np.testing.assert_allclose(path[:, 0, 3], np.linspace(0, 10, 2129), atol=1e-9)
    check_on_the_screw(path)


@pytest.mark.parametrize(
    ("make", "count"),
    [
        (lambda poses: paths.polyline(poses), COUNT),
        (lambda poses: paths.polyline(poses, blend=1e-6), 2 * COUNT - 2),
        (lambda poses: paths.waypoints(poses, 0.01, times=np.linspace(0, 15.4, COUNT)), 1541),
        (lambda poses: paths.waypoints(poses, 0.01, stop=False, speed=0.5, angular_speed=100), 2001),
        (lambda poses: paths.waypoints(poses, 1.0), COUNT),
    ],
)
def test_a_million_poses_are_gone_through(screw, make, count):
    path = make(screw)
    assert abs(len(path) - count) <= 1
    check_on_the_screw(path)
    np.testing.assert_allclose(path[[0, -1]], screw[[0, -1]], atol=1e-12)


def test_a_million_poses_are_made(rng):
    A, B, C = random_poses(rng, 3)
    for make in (
        lambda step: paths.line(A, B, step=step),
        lambda step: paths.arc(A, B, C, step=step),
        lambda step: paths.circle(A, 0.2, tangent=True, step=step),
        lambda step: paths.letters("A", 0.1, A, step=step),
    ):
        step = paths.length(make(0.001)) / COUNT
        path = make(step)
        assert len(path) == pytest.approx(COUNT, rel=0.01)
        assert distances(path).max() <= step * (1 + 1e-6)


def down(x: float, y: float, z: float, yaw: float = 0.0) -> object:
    """The tool points down."""
    return mq.pose([x, y, z], rpy=[np.pi, 0, yaw])


CORNERS = down(0.5, -0.2, 0.6), down(0.7, 0.0, 0.6), down(0.5, 0.2, 0.8)


@pytest.mark.parametrize(
    "path",
    [
        paths.line(down(0.5, -0.2, 0.6), down(0.5, 0.2, 0.6, yaw=0.5)),
        paths.arc(*CORNERS),
        paths.circle(down(0.5, 0.0, 0.6), 0.15, step=0.01),
        paths.spiral(down(0.5, 0.0, 0.6), 0.05, 0.15, turns=2, pitch=0.05, step=0.01),
        paths.polyline(CORNERS, blend=0.05, step=0.01),
        paths.square(down(0.5, 0.0, 0.6), 0.3, blend=0.05, step=0.01),
        paths.cube(down(0.5, 0.0, 0.6), 0.15, step=0.02),
        paths.letters("MAIRA 7", 0.08, down(0.0, 0.0, 0.0), frame=mq.pose([0.45, -0.25, 0.5], rpy=[0, 0, np.pi / 2])),
        paths.waypoints(CORNERS, 0.05, acceleration=1.0),
    ],
    ids=["line", "arc", "circle", "spiral", "polyline", "square", "cube", "letters", "waypoints"],
)
def test_maira_follows_what_is_made(maira, path):
    followed = mq.Solver(maira).track(path)
    assert bool(followed), followed.reason
    for q, T in zip(followed.q, path, strict=True):
        assert np.abs(mq.pose_error(maira.forward(q), T)).max() < 2e-6
