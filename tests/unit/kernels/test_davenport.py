"""Three rotations about given axes against matrices, at right angles and not, near singularities and at holes."""

import numpy as np
import pytest
from support.srs_arms import random_rotation

from maira_qp.analytic.srs.geometry import REACHED_WITHIN, SphericalJoint, rotations, wrapped


def joint(rng: np.random.Generator, right_angles: bool) -> SphericalJoint:
    """Axes a, b, c, adjacent ones at right angles or at any angle."""
    a, b, c = np.eye(3)[[2, 1, 2]] if right_angles else rng.normal(size=(3, 3))
    turn = random_rotation(rng, 3.0)
    return SphericalJoint(*(turn @ (axis / np.linalg.norm(axis)) for axis in (a, b, c)))


def made(joint: SphericalJoint, q: np.ndarray) -> np.ndarray:
    """R_a R_b R_c (..., 3, 3) of angles (..., 3)."""
    return rotations(joint.a, q[..., 0]) @ rotations(joint.b, q[..., 1]) @ rotations(joint.c, q[..., 2])


def naive(joint: SphericalJoint, R: np.ndarray) -> np.ndarray:
    """Both triples (2, 3) by the arc cosine of `a . R c = k_0 + rho cos(q_b - phi)`, or NaN."""
    cosine = (joint.a @ R @ joint.c - joint.constant) / joint.amplitude
    triples = []
    for theta in (1, -1) * np.array([np.arccos(cosine) if abs(cosine) <= 1 else np.nan]):
        R_b, across = rotations(joint.b, joint.phase + theta), np.cross(joint.a, R @ joint.c)
        x = np.cross(joint.a, R_b @ joint.c)
        q_a = np.arctan2(np.cross(x, across) @ joint.a, x @ across)
        R_c = (rotations(joint.a, q_a) @ R_b).T @ R
        axis = 0.5 * np.array([R_c[2, 1] - R_c[1, 2], R_c[0, 2] - R_c[2, 0], R_c[1, 0] - R_c[0, 1]])
        q_c = np.arctan2(axis @ joint.c, 0.5 * (np.trace(R_c) - 1))
        triples.append([q_a, joint.phase + theta, q_c])
    return np.array(triples)


@pytest.mark.parametrize("right_angles", [True, False])
def test_the_angles_are_those_of_the_twin(rng, right_angles):
    """All of 400 rotations; what axes that are not at right angles leave out is NaN in both."""
    holes = 0
    for _ in range(20):
        axes = joint(rng, right_angles)
        R = np.array([random_rotation(rng, np.pi) for _ in range(20)])
        found, expected = axes.decompose(R), np.array([naive(axes, each) for each in R])
        np.testing.assert_array_equal(np.isnan(found), np.isnan(expected))
        known = ~np.isnan(found)
        np.testing.assert_allclose(wrapped(found - expected)[known], 0, atol=1e-6)
        np.testing.assert_allclose(
            made(axes, found)[known.all(axis=-1)],
            np.repeat(R, 2, 0).reshape(-1, 2, 3, 3)[known.all(axis=-1)],
            atol=1e-14,
        )
        holes += int((~known).any(axis=(1, 2)).sum())
    assert (holes == 0) is right_angles


@pytest.mark.parametrize("away", [0.0, 1e-15, 1e-12, 1e-8, 1e-4])
@pytest.mark.parametrize("right_angles", [True, False])
def test_rotations_are_met_next_to_singularities_and_edges(rng, right_angles, away):
    """The middle joint is next to where the two triples meet; an arc cosine would lose half the digits there."""
    for _ in range(20):
        axes = joint(rng, right_angles)
        q = np.array([rng.uniform(-3, 3), axes.phase + rng.choice([0.0, np.pi]) + away, rng.uniform(-3, 3)])
        R = made(axes, q)
        found = axes.decompose(R)
        np.testing.assert_allclose(made(axes, found), np.broadcast_to(R, (2, 3, 3)), atol=3e-15 + REACHED_WITHIN)


def test_any_shape_is_taken(rng):
    axes = joint(rng, True)
    R = np.array([[random_rotation(rng, 1.0) for _ in range(3)] for _ in range(2)])
    assert axes.decompose(R).shape == (2, 3, 2, 3)
    np.testing.assert_array_equal(axes.decompose(R[1, 2]), axes.decompose(R)[1, 2])
    assert axes.decompose(R[:0]).shape == (0, 3, 2, 3)
