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

    def frame(self, camera: viser.InitialCameraConfig | viser.CameraHandle, aspect: float = 1.0) -> None:
        """Stand where all of it is seen in a picture of this width by height; in a tall one, in its upper half."""
        narrow = min(FIELD, 2 * float(np.arctan(np.tan(0.5 * FIELD) * aspect)))
        away = self.radius / np.sin(0.5 * narrow)
        back = SIDE / np.linalg.norm(SIDE)
        up = np.array([0.0, 0.0, 1.0]) - back[2] * back
        lowered = LOWERED * away * np.tan(0.5 * FIELD) * up / np.linalg.norm(up) if aspect < TALL else np.zeros(3)
        camera.position = self.middle + away * back - lowered
        camera.look_at, camera.fov = self.middle - lowered, float(FIELD)


class Stand:
    """The camera of one page: put where the arm is seen, also when the page changes its shape, until somebody moves it.

    A page tells its shape more than once while it is laid out, and a camera that it tells late may stand where it was
    put before the last time.
    """

    def __init__(self, camera: viser.CameraHandle, ball: Ball) -> None:
        self._camera, self._ball = camera, ball
        self._put_at = [np.array(camera.position)]
        self._put()
        camera.on_update(lambda _: self._reshape())

    def see(self, ball: Ball) -> None:
        """Stand where this ball is seen, whoever moved the camera."""
        self._ball = ball
        self._put_at.clear()
        self._put()

    def _reshape(self) -> None:
        if self._camera.aspect != self._aspect and self._is_unmoved():
            self._put()

    def _is_unmoved(self) -> bool:
        at = np.asarray(self._camera.position)
        return any(np.linalg.norm(at - put) < UNMOVED for put in self._put_at)

    def _put(self) -> None:
        self._aspect = self._camera.aspect
        self._ball.frame(self._camera, self._aspect)
        self._put_at.append(np.array(self._camera.position))


def _corners(body: Body) -> np.ndarray:
    """(8, 3) of the box around a body, in its link's frame."""
    low, high = body.surface.vertices.min(axis=0), body.surface.vertices.max(axis=0)
    return np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, -1).T
