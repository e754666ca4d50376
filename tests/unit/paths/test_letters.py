"""Letters: on their plane, the pen lifted between strokes."""

import numpy as np
import pytest
from support.paths import distances, random_pose

import maira_qp as mq
from maira_qp import paths
from maira_qp.errors import OptionError, PoseError

ALL = "ABCDEFGHIJKLMNOPQRSTUVWXYZ 0123456789"


def strokes(local: np.ndarray) -> list[np.ndarray]:
    """The parts of a path (N, 4, 4), given in the frame of the text, in which the pen is down, each (K, 2)."""
    down = np.abs(local[:, 2, 3]) < 1e-9
    edges = np.flatnonzero(np.diff(np.concatenate([[False], down, [False]]).astype(int)))
    return [local[begin:end, :2, 3] for begin, end in edges.reshape(-1, 2)]


def test_every_letter_is_drawn_on_the_plane_and_lifted_off_it(rng):
    origin = random_pose(rng)
    path = paths.letters(ALL, 0.06, origin, lift=0.015, step=0.002)
    local = np.linalg.inv(origin.homogeneous) @ path
    np.testing.assert_allclose(local[:, :3, :3], np.broadcast_to(np.eye(3), (len(path), 3, 3)), atol=1e-12)
    z = local[:, 2, 3]
    assert z.max() < 1e-12
    np.testing.assert_allclose(z[[0, -1]], -0.015, atol=1e-12)
    np.testing.assert_allclose(z.min(), -0.015, atol=1e-12)
    down = np.concatenate(strokes(local))
    np.testing.assert_allclose([down[:, 1].min(), down[:, 1].max()], [-0.06, 0.0], atol=1e-12)
    assert down[:, 0].min() >= -1e-12
    assert distances(path).max() <= 0.002 * (1 + 1e-9)


def test_the_pen_goes_sideways_only_on_the_plane_or_lifted():
    path = paths.letters("HELLO", 0.1, mq.pose())
    between = (path[:, 2, 3] < -1e-9) & (path[:, 2, 3] > -0.02 + 1e-9)
    sideways = np.linalg.norm(np.diff(path[:, :2, 3], axis=0), axis=1)
    assert between.any()
    assert sideways[between[:-1] | between[1:]].max() < 1e-12


def test_letters_have_their_shapes():
    counts = {letter: len(strokes(paths.letters(letter, 0.1, mq.pose()))) for letter in ALL.replace(" ", "")}
    assert {letter for letter, count in counts.items() if count == 3} == {"H"}
    assert {letter for letter in "CGIJLMNOSUVWZ" if counts[letter] != 1} == set()
    shapes = [np.concatenate(strokes(paths.letters(letter, 0.1, mq.pose()))) for letter in ALL.replace(" ", "")]
    for i, one in enumerate(shapes):
        for other in shapes[:i]:
            apart = np.linalg.norm(one[:, None] - other[None], axis=2)
            assert max(apart.min(axis=0).max(), apart.min(axis=1).max()) > 0.012  # most of a square of the grid
    ((h, v),) = [strokes(paths.letters("T", 0.1, mq.pose()))]
    assert np.ptp(h[:, 1]) < 1e-12
    assert np.ptp(v[:, 0]) < 1e-12
    np.testing.assert_allclose(h[:, 1], -0.1, atol=1e-12)  # the bar of the T is on top


def test_letters_follow_each_other_without_touching():
    drawn = [strokes(paths.letters("AB" * k, 0.1, mq.pose())) for k in (1, 2)]
    width = max(each[:, 0].max() for each in drawn[0])
    rest = np.concatenate(drawn[1][len(drawn[0]) :])
    assert rest[:, 0].min() > width + 0.01
    spaced = strokes(paths.letters("A B", 0.1, mq.pose()))
    assert spaced[-1][:, 0].max() > width + 0.01


def test_small_letters_are_drawn_as_capitals():
    np.testing.assert_array_equal(paths.letters("maira", 0.1, mq.pose()), paths.letters("MAIRA", 0.1, mq.pose()))


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda T: paths.letters("A-B", 0.1, T), OptionError, "'-'; valid names: .*, A, B, C"),
        (lambda T: paths.letters("", 0.1, T), OptionError, "nothing to draw"),
        (lambda T: paths.letters("  ", 0.1, T), OptionError, "nothing to draw"),
        (lambda T: paths.letters(7, 0.1, T), OptionError, "text must be a string"),
        (lambda T: paths.letters("A" * 1001, 0.1, T), OptionError, "at most 1000 characters"),
        (lambda T: paths.letters("A", 0, T), OptionError, "height must be a positive number"),
        (lambda T: paths.letters("A", 0.1, T, lift=-0.1), OptionError, "lift must be a positive number"),
        (lambda T: paths.letters("A", 0.1, [0, 0, 0]), PoseError, "origin must be"),
    ],
)
def test_what_cannot_be_drawn_is_named(call, error, message):
    with pytest.raises(error, match=message):
        call(mq.pose())
