"""The grids of a map: cells that tile, orientations that are uniform, and what is nearest is found."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from maira_qp.scale.reach.grid import AROUND, Orientations, Positions


def test_cells_are_counted_with_z_fastest_and_each_point_is_in_its_own(rng):
    grid = Positions(0.1, (-3, 0, 5), (6, 4, 3))
    centres = grid.centres(0, grid.count)
    np.testing.assert_allclose(centres[0], [-0.25, 0.05, 0.55])
    np.testing.assert_allclose(centres[1] - centres[0], [0, 0, 0.1], atol=1e-15)
    points = centres + rng.uniform(-0.049, 0.049, centres.shape)
    np.testing.assert_array_equal(grid.index(points), np.arange(grid.count))
    np.testing.assert_array_equal(grid.centres(17, 30), centres[17:30])
    outside = [[0.31, 0.1, 0.6], [0, -0.001, 0.6], [0, 0.1, 0.81], [np.nan, 0.1, 0.6], [np.inf, 0.1, 0.6]]
    assert (grid.index(np.array(outside)) == -1).all()


def test_cells_around_a_point_interpolate_what_is_linear(rng):
    grid = Positions(0.1, (-3, 0, 5), (6, 4, 1))
    low, high = grid.centres(0, grid.count)[[0, -1]]
    points = rng.uniform(low - 0.2, high + 0.2, (500, 3))
    points[0], points[1] = np.nan, 1e308
    cells, weights = grid.around(points)
    assert cells.shape == weights.shape == (8, 500)
    assert (weights >= 0).all()
    np.testing.assert_allclose(weights.sum(axis=0), 1.0)
    between = (weights[..., None] * grid.centres(0, grid.count)[cells]).sum(axis=0)
    np.testing.assert_allclose(between[1:], np.clip(points, low, high)[1:], atol=1e-12)


@pytest.mark.parametrize(("directions", "rolls"), [(1, 1), (2, 5), (50, 7), (200, 1)])
def test_orientations_are_rotations_with_the_directions_as_z_axes(directions, rolls):
    grid = Orientations(directions, rolls)
    R = grid.rotations.reshape(-1, 3, 3)
    assert len(R) == grid.count
    np.testing.assert_allclose(R @ R.swapaxes(1, 2), np.broadcast_to(np.eye(3), R.shape), atol=1e-14)
    np.testing.assert_allclose(np.linalg.det(R), 1.0)
    np.testing.assert_allclose(grid.rotations[:, 0, :, 2], grid.vectors)


def test_orientations_are_uniform_over_all_rotations():
    """The mean of R, and of R (x) R, are those of the uniform measure: 0, and the projection onto what turns leave."""
    R = Orientations(400, 12).rotations.reshape(-1, 3, 3)
    assert np.abs(R.mean(axis=0)).max() < 2e-3
    second = np.einsum("kab,kcd->abcd", R, R) / len(R)
    uniform = np.einsum("ac,bd->abcd", np.eye(3), np.eye(3)) / 3.0
    assert np.abs(second - uniform).max() < 5e-3


@pytest.mark.parametrize(("directions", "rolls"), [(30, 1), (30, 8), (1, 3)])
def test_the_nearest_orientation_has_the_nearest_direction_and_then_the_nearest_roll(directions, rolls, rng):
    grid = Orientations(directions, rolls)
    own = grid.rotations.reshape(-1, 3, 3)
    np.testing.assert_array_equal(grid.nearest(own), np.arange(grid.count))
    R = Rotation.random(200, random_state=3).as_matrix()
    found = grid.nearest(R)
    for one, k in zip(R, found, strict=True):
        direction = np.argmax(grid.vectors @ one[:, 2])
        assert k // rolls == direction
        # turned the short way onto the direction, the angle to each roll
        axis = np.cross(one[:, 2], grid.vectors[direction])
        angle = np.arctan2(np.linalg.norm(axis), one[:, 2] @ grid.vectors[direction])
        turned = Rotation.from_rotvec(axis / np.linalg.norm(axis) * angle).as_matrix() @ one
        x = turned[:, 0] if rolls == 1 else one[:, 0] - one[:, 0] @ grid.vectors[direction] * grid.vectors[direction]
        cosines = grid.rotations[direction, :, :, 0] @ (x / np.linalg.norm(x))
        assert cosines[k % rolls] == pytest.approx(cosines.max(), abs=1e-9)


def weights_of(grid: Orientations, R: np.ndarray) -> np.ndarray:
    """The weights around rotations (N, 3, 3), of all orientations of a grid (N, M)."""
    around = grid.around(R)
    every = np.zeros((len(R), grid.count))
    for index, weight in zip(*around, strict=True):
        np.add.at(every, (np.arange(len(R)), index), weight)
    return every


@pytest.mark.parametrize(("directions", "rolls"), [(50, 1), (50, 6), (AROUND + 1, 2)])
def test_orientations_around_a_rotation_are_those_of_the_nearest_directions_and_of_two_rolls(directions, rolls, rng):
    grid = Orientations(directions, rolls)
    R = Rotation.from_quat(rng.normal(size=(300, 4))).as_matrix()
    weights = weights_of(grid, R).reshape(-1, directions, rolls)
    assert (weights >= 0).all()
    np.testing.assert_allclose(weights.sum(axis=(1, 2)), 1.0)
    near = np.argsort(-(R[:, :, 2] @ grid.vectors.T), axis=1)[:, :AROUND]
    of_directions = weights.sum(axis=2)
    np.testing.assert_allclose(np.take_along_axis(of_directions, near, axis=1).sum(axis=1), 1.0)
    assert np.diff(np.take_along_axis(of_directions, near, axis=1), axis=1).max() <= 0.0
    assert ((weights > 0).sum(axis=2) <= 2).all()


@pytest.mark.parametrize("rolls", [1, 3])
def test_weights_of_orientations_have_no_jumps(rolls, rng):
    grid = Orientations(50, rolls)
    R = Rotation.from_quat(rng.normal(size=(2000, 4)))
    beside = (Rotation.from_rotvec(1e-3 * rng.normal(size=(2000, 3))) * R).as_matrix()
    change = np.abs(weights_of(grid, R.as_matrix()) - weights_of(grid, beside))
    assert 1e-4 < change.max() < 0.02


def test_where_there_are_few_directions_it_is_the_nearest_orientation(rng):
    R = Rotation.from_quat(rng.normal(size=(50, 4))).as_matrix()
    grid = Orientations(AROUND, 2)
    index, weights = grid.around(R)
    np.testing.assert_array_equal(index[0], grid.nearest(R))
    np.testing.assert_array_equal(weights, np.ones((1, 50)))


def test_rotations_that_hold_nan_or_are_none_are_taken_to_some_orientation():
    R = np.full((3, 3, 3), np.nan)
    R[1], R[2] = np.inf, 1e300
    assert ((Orientations(10, 3).nearest(R) >= 0) & (Orientations(10, 3).nearest(R) < 30)).all()
    index, weights = Orientations(10, 3).around(R)
    assert ((index >= 0) & (index < 30) & np.isfinite(weights)).all()
