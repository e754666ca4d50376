"""The two arms of the literature, against their published tables and figures."""

from math import pi

import numpy as np
import pytest

from maira_qp.robots.model import catalog


def test_maira_is_the_published_table():
    table = catalog.maira()
    assert [(link.d, link.a, link.theta) for link in table.links] == [
        *((0.438, 0, 0), (0, 0, 0), (0.7, 0, 0), (0, 0, 0), (0.7, 0, 0), (0, 0, 0), (0.115, 0, 0))
    ]
    assert [link.alpha for link in table.links] == [-pi / 2, pi / 2, -pi / 2, pi / 2, -pi / 2, pi / 2, 0]
    assert np.rad2deg(table.upper).tolist() == pytest.approx([180, 120, 180, 150, 180, 180, 180])
    assert (table.lower == -table.upper).all()


def test_maira_stands_upright_at_zero():
    T = np.eye(4)
    T[2, 3] = 0.438 + 0.7 + 0.7 + 0.115
    assert catalog.maira().forward(np.zeros(7)) == pytest.approx(T, abs=1e-15)


def test_maira_has_a_spherical_shoulder_and_wrist(rng):
    """Joints 1-3 leave the shoulder where it is, 5-7 the wrist."""
    table = catalog.maira()
    for _ in range(20):
        q = rng.uniform(table.lower, table.upper)
        htms = table.compute_htms(q)
        shoulder, elbow, wrist, tool = (htms[i][:3, 3] for i in (1, 3, 5, 7))
        assert shoulder == pytest.approx([0, 0, 0.438], abs=1e-15)
        assert np.linalg.norm(elbow - shoulder) == pytest.approx(0.7)
        assert np.linalg.norm(wrist - elbow) == pytest.approx(0.7)
        assert np.linalg.norm(tool - wrist) == pytest.approx(0.115)
        q[4:] = rng.uniform(-1, 1, 3)
        assert table.compute_htms(q)[5][:3, 3] == pytest.approx(wrist, abs=1e-14)


def test_iiwa14_is_the_published_table():
    table = catalog.iiwa14()
    assert [link.d for link in table.links] == [0.36, 0, 0.42, 0, 0.4, 0, 0.126]
    assert [link.alpha for link in table.links] == [pi / 2, -pi / 2, -pi / 2, pi / 2, pi / 2, -pi / 2, 0]
    assert all(link.a == link.theta == 0 for link in table.links)
    assert np.rad2deg(table.upper).tolist() == pytest.approx([170, 120, 170, 120, 170, 120, 170])
    assert (table.lower == -table.upper).all()
    assert np.rad2deg([link.velocity for link in table.links]) == pytest.approx([85, 85, 100, 75, 130, 135, 135])
    assert [link.effort for link in table.links] == [320, 320, 176, 176, 110, 40, 40]


POSE = [[0.997, 0.046, -0.063, 0.358], [-0.078, 0.527, -0.847, -0.484], [-0.006, 0.849, 0.528, 0.825], [0, 0, 0, 1]]


@pytest.mark.parametrize(
    "degrees",
    [
        [173.98, 26.64, -61.56, -73.01, -114.87, 40.73, 37.9],
        [-87.28, -28.15, 65.39, 73.01, -148.2, -68.95, -171.69],
    ],
)
def test_iiwa14_reaches_the_lectures_pose(degrees):
    """The lecture's Examples 2 and 3, printed to 0.01° and three decimals."""
    assert catalog.iiwa14().forward(np.deg2rad(degrees)) == pytest.approx(np.array(POSE), abs=1e-3)


@pytest.mark.parametrize("degrees", [[0, -95.584, 0, -68.874, 0, 61.447, 0], [0, 0, 0, 90, 0, 0, 0]])
def test_iiwa14_reaches_the_lectures_point(degrees):
    assert catalog.iiwa14().forward(np.deg2rad(degrees))[:3, 3] == pytest.approx([0.526, 0, 0.78], abs=1e-3)
