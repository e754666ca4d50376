"""Where the camera of a page stands."""

import numpy as np
import pytest

from maira_qp.apps.viewer.drawing.camera import Ball, Stand


class Camera:
    """What a page tells, and is told."""

    def __init__(self, aspect: float) -> None:
        self.aspect, self.position = aspect, np.array([3.0, 3.0, 3.0])
        self.look_at, self.fov = np.zeros(3), 0.0
        self._hear = None

    def on_update(self, hear) -> None:
        """Whom it tells."""
        self._hear = hear

    def says(self, aspect: float, position) -> None:
        """A message of the page."""
        self.aspect, self.position = aspect, np.asarray(position, dtype=float)
        self._hear(self)


@pytest.fixture(scope="module")
def balls(maira) -> list[Ball]:
    return [Ball(maira, q, []) for q in (np.zeros(7), np.full(7, 0.7))]


def where(ball: Ball, aspect: float) -> np.ndarray:
    camera = Camera(aspect)
    ball.frame(camera, aspect)
    return camera.position


def test_a_page_that_changes_its_shape_sees_the_arm_whole(balls):
    camera = Camera(2.0)
    Stand(camera, balls[0])
    np.testing.assert_allclose(camera.position, where(balls[0], 2.0))
    camera.says(0.46, camera.position)
    np.testing.assert_allclose(camera.position, where(balls[0], 0.46))


def test_what_a_page_says_while_its_camera_is_put_is_heard(balls):
    class Hasty(Camera):
        """Says its shape as soon as it is told where to stand."""

        def __setattr__(self, name, value) -> None:
            super().__setattr__(name, value)
            if name == "fov" and value and self.aspect == 2.0:
                self.aspect = 0.46

    camera = Hasty(2.0)
    Stand(camera, balls[0])
    np.testing.assert_allclose(camera.position, where(balls[0], 0.46))


def test_what_a_page_says_late_moves_nothing(balls):
    """The position that it had before it was told where to stand, with its new shape."""
    camera = Camera(2.0)
    Stand(camera, balls[0])
    camera.says(0.46, [3.0, 3.0, 3.0])
    np.testing.assert_allclose(camera.position, where(balls[0], 0.46))


def test_a_page_that_begins_anew_where_pages_begin_sees_the_arm(balls):
    camera = Camera(0.46)
    Stand(camera, balls[0])
    camera.says(0.46, where(balls[0], 1.0))
    np.testing.assert_allclose(camera.position, where(balls[0], 0.46))


@pytest.mark.parametrize("aspect", [2.0, 0.46])
def test_a_camera_that_somebody_moved_stays(balls, aspect):
    camera = Camera(2.0)
    Stand(camera, balls[0])
    moved = camera.position + np.array([0.0, 0.1, 0.0])
    camera.says(aspect, moved)
    np.testing.assert_array_equal(camera.position, moved)


def test_another_arm_is_seen_whoever_moved_the_camera(balls):
    camera = Camera(1.5)
    stand = Stand(camera, balls[0])
    camera.says(1.5, camera.position + np.array([0.0, 0.1, 0.0]))
    stand.see(balls[1])
    np.testing.assert_allclose(camera.position, where(balls[1], 1.5))
