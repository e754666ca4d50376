"""Where the camera stands, so that the whole arm is seen."""

from __future__ import annotations

import numpy as np
import viser

from maira_qp.apps.viewer.drawing.geometry import Body
from maira_qp.robots.model.robot import Robot

FIELD = np.radians(45)
"""From the top of the picture to its bottom."""
SIDE = np.array([0.62, -0.68, 0.4])
"""From where the arm is looked at: ahead of it, to its right and above."""
TALL = 0.8
"""A picture of less width by height is that of a phone, whose lower half the panel takes."""
LOWERED = 0.5
"""How far a tall picture is looked at below the middle of the arm, in halves of its height."""
SQUARE = 1.0
"""Width by height of the picture that a page is taken to have before it says so."""
ROOM = 1.15
"""How much larger the ball that is seen whole is than the arm."""
UNMOVED = 1e-3
"""A camera this near [m] to where it was put was not moved by anybody."""


class Ball:
    """A ball that holds an arm at a configuration."""

    def __init__(self, robot: Robot, q: np.ndarray, bodies: list[Body]) -> None:
        at = robot.at(q)
        links = [robot.base, *robot.moved_links, *robot.tips]
        points = [at.placement(link).translation[None] for link in links]
        points += [_corners(body) @ at.placement(body.link).rotation.T + at.placement(body.link).translation
                   for body in bodies]  # fmt: skip
        seen = np.concatenate(points)
        self.middle = 0.5 * (seen.min(axis=0) + seen.max(axis=0))
        self.radius = ROOM * float(np.linalg.norm(seen - self.middle, axis=1).max())

    def frame(self, camera: viser.InitialCameraConfig | viser.CameraHandle, aspect: float = SQUARE) -> None:
        """Stand where all of it is seen in a picture of this width by height; in a tall one, in its upper half."""
        camera.position, camera.look_at = self.seen_from(aspect)
        camera.fov = float(FIELD)

    def seen_from(self, aspect: float) -> tuple[np.ndarray, np.ndarray]:
        """From where (3,) it is seen so, and what (3,) is then in the middle of the picture."""
        narrow = min(FIELD, 2 * float(np.arctan(np.tan(0.5 * FIELD) * aspect)))
        away = self.radius / np.sin(0.5 * narrow)
        back = SIDE / np.linalg.norm(SIDE)
        up = np.array([0.0, 0.0, 1.0]) - back[2] * back
        lowered = LOWERED * away * np.tan(0.5 * FIELD) * up / np.linalg.norm(up) if aspect < TALL else np.zeros(3)
        return self.middle + away * back - lowered, self.middle - lowered


class Stand:
    """The camera of one page: put where the arm is seen, also when the page changes its shape, until somebody moves it.

    What a page says of its camera may be late, and it puts the camera to where pages begin after it has connected, or
    again: a camera at any place where it was put before is put to the right one.
    """

    def __init__(self, camera: viser.CameraHandle, ball: Ball) -> None:
        self._camera, self._ball = camera, ball
        self._put_at = [np.array(camera.position), ball.seen_from(SQUARE)[0]]
        camera.on_update(lambda _: self._put_again())
        self._put()
        self._put_again()  # what the page said meanwhile

    def see(self, ball: Ball) -> None:
        """Stand where this ball is seen, whoever moved the camera."""
        self._ball = ball
        self._put_at = [ball.seen_from(SQUARE)[0]]
        self._put()

    def _put_again(self) -> None:
        if self._is_at(self._put_at) and not self._is_at([self._ball.seen_from(self._camera.aspect)[0]]):
            self._put()

    def _is_at(self, places: list[np.ndarray]) -> bool:
        at = np.asarray(self._camera.position)
        return any(np.linalg.norm(at - place) < UNMOVED for place in places)

    def _put(self) -> None:
        self._ball.frame(self._camera, self._camera.aspect)
        self._put_at.append(np.array(self._camera.position))


def _corners(body: Body) -> np.ndarray:
    """(8, 3) of the box around a body, in its link's frame."""
    low, high = body.surface.vertices.min(axis=0), body.surface.vertices.max(axis=0)
    return np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, -1).T
