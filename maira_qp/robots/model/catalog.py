"""The two arms of the literature that this package is built around, as DH tables."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import pi, radians

from maira_qp.robots.dh.table import DHLink, DHTable


def maira() -> DHTable:
    """MAIRA, a 7-axis spherical-revolute-spherical arm; limits ±180°, but A2 ±120° and A4 ±150°.

    The source gives no speeds and torques: those of `DHLink` stand.
    """
    d = (0.438, 0.0, 0.7, 0.0, 0.7, 0.0, 0.115)
    alpha = (-pi / 2, pi / 2, -pi / 2, pi / 2, -pi / 2, pi / 2, 0.0)
    limit = (180, 120, 180, 150, 180, 180, 180)
    return _arm("maira", d, alpha, limit)


def iiwa14() -> DHTable:
    """KUKA LBR iiwa 14 R820; limits ±170°, but A2, A4, A6 ±120°; speeds and torques from KUKA's data sheet."""
    d = (0.36, 0.0, 0.42, 0.0, 0.4, 0.0, 0.126)
    alpha = (pi / 2, -pi / 2, -pi / 2, pi / 2, pi / 2, -pi / 2, 0.0)
    limit = (170, 120, 170, 120, 170, 120, 170)
    speed = (85, 85, 100, 75, 130, 135, 135)
    torque = (320, 320, 176, 176, 110, 40, 40)
    return _arm("iiwa14", d, alpha, limit, speed, torque)


def _arm(
    name: str,
    d: Sequence[float],
    alpha: Sequence[float],
    limit: Sequence[float],
    speed: Sequence[float] | None = None,
    torque: Sequence[float] | None = None,
) -> DHTable:
    """A chain of revolute links with a = 0; limits and speeds in degrees (and per second)."""
    links = [DHLink(d=d[i], alpha=alpha[i], lower=-radians(limit[i]), upper=radians(limit[i])) for i in range(len(d))]
    if speed is not None:
        links = [replace(link, velocity=radians(value)) for link, value in zip(links, speed, strict=True)]
    if torque is not None:
        links = [replace(link, effort=float(value)) for link, value in zip(links, torque, strict=True)]
    return DHTable(links, name=name)
