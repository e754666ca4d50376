"""Roll, pitch and yaw: there and back at every rotation, exact at right angles."""

from itertools import product
from math import cos, pi, sin

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from maira_qp.robots.urdf.rpy import cosine_sine, matrix_from_rpy, rpy_from_matrix


def test_the_definition_is_scipys_fixed_xyz(rng):
    for rpy in rng.uniform(-7, 7, (200, 3)):
        assert np.abs(matrix_from_rpy(rpy) - Rotation.from_euler("xyz", rpy).as_matrix()).max() < 1e-15


def test_there_and_back_at_random_rotations(rng):
    for R in Rotation.from_quat(rng.normal(size=(500, 4))).as_matrix():
        assert np.abs(matrix_from_rpy(rpy_from_matrix(R)) - R).max() < 2e-15


@pytest.mark.parametrize("away", [0, 1e-17, 1e-12, 1e-9, 1e-8, 1e-6, 1e-3])
def test_there_and_back_near_the_gimbal_lock(away, rng):
    """At a pitch of ±90°, where asin loses half of the digits and roll and yaw are one."""
    for sign in (1, -1):
        for roll, yaw in rng.uniform(-pi, pi, (50, 2)):
            R = matrix_from_rpy(np.array([roll, sign * (pi / 2 - away), yaw]))
            assert np.abs(matrix_from_rpy(rpy_from_matrix(R)) - R).max() < 2e-15


def test_right_angles_are_exact():
    """All 64 products of quarter turns have entries 0, 1 and -1, and come back as such."""
    for quarters in product(range(4), repeat=3):
        R = matrix_from_rpy(np.array(quarters) * pi / 2)
        assert set(np.abs(R).ravel()) == {0.0, 1.0}
        again = matrix_from_rpy(rpy_from_matrix(R))
        assert (again == R).all()


def test_small_angles_are_kept():
    """1e-17 rad is not rounding noise of zero, it is meant."""
    assert cosine_sine(1e-17) == (1.0, 1e-17)
    assert cosine_sine(pi) == (-1.0, 0.0)
    assert cosine_sine(-pi / 2) == (0.0, -1.0)
    assert cosine_sine(pi / 2 + 1e-14) == (cos(pi / 2 + 1e-14), sin(pi / 2 + 1e-14))
