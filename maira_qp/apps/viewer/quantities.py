"""Lengths in millimetres and angles in degrees, as a person reads and types them."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable

import numpy as np
import pinocchio as pin

from maira_qp.errors import OptionError, shown
from maira_qp.orientation import matrix_from_quaternion, quaternion_from_matrix
from maira_qp.robots.urdf.rpy import matrix_from_rpy, rpy_from_matrix
from maira_qp.wording import SentenceUnits

MILLI = 1e3
LEAST_LENGTH, LEAST_ANGLE = 1e-9, 1e-6
"""What is less [m, deg] is rounding, and not worth its digits."""
DECIMALS = 3
"""Of what is typed in mm and degrees."""


def length(metres: float) -> str:
    """A length as it is best read: nm and µm where it is small, else mm."""
    if metres < LEAST_LENGTH:
        return "< 1 nm"
    if metres < 1e-6:
        return f"{1e9 * metres:.0f} nm"
    return f"{1e6 * metres:.1f} µm" if metres < 1e-4 else f"{MILLI * metres:.1f} mm"


def angle(radians: float) -> str:
    """An angle in degrees as it is best read."""
    degrees = math.degrees(radians)
    if abs(degrees) < LEAST_ANGLE:
        return "< 0.000001°"
    return f"{degrees:.6f}°" if abs(degrees) < 1e-2 else f"{degrees:.2f}°"


UNITS = SentenceUnits(length, angle)
"""Of sentences that are shown."""


def listing(values: Iterable[float], decimals: int = DECIMALS) -> str:
    """Numbers with commas between them, without trailing zeros."""
    return ", ".join(_trimmed(value, decimals) for value in values)


def numbers(text: str, count: int, what: str) -> np.ndarray:
    """Finite numbers (count,) of a text, with commas, semicolons or spaces between them. Raises `OptionError`."""
    words = [word for word in re.split(r"[,;\s]+", text.strip(" \t[]()")) if word]
    try:
        values = np.array([float(word) for word in words])
    except ValueError:
        values = np.array([])
    if len(values) != count or not np.isfinite(values).all():
        such = listing(range(1, count + 1))
        raise OptionError(f"{what}: {count} number{'s' * (count > 1)}, such as {such}, not {shown(text)}")
    return values


def position_text(T: pin.SE3) -> str:
    """x, y, z [mm]"""
    return listing(MILLI * T.translation)


def rpy_text(T: pin.SE3) -> str:
    """Roll, pitch, yaw [deg]"""
    return listing(np.degrees(rpy_from_matrix(T.rotation)))


def quaternion_text(T: pin.SE3) -> str:
    """w, x, y, z"""
    return listing(quaternion_from_matrix(T.rotation), 6)


def position_of(text: str) -> np.ndarray:
    """(3,) [m] of x, y, z [mm]. Raises `OptionError`."""
    return numbers(text, 3, "x, y, z [mm]") / MILLI


def rotation_of_rpy(text: str) -> np.ndarray:
    """(3, 3) of roll, pitch, yaw [deg]. Raises `OptionError`."""
    return matrix_from_rpy(np.radians(numbers(text, 3, "roll, pitch, yaw [deg]")))


def rotation_of_quaternion(text: str) -> np.ndarray:
    """(3, 3) of w, x, y, z of any length but zero. Raises `OptionError`."""
    values = numbers(text, 4, "w, x, y, z")
    size = float(np.linalg.norm(values))
    if not size > 0:
        raise OptionError("w, x, y, z: a quaternion of zeros is no orientation")
    return matrix_from_quaternion(values / size)


def _trimmed(value: float, decimals: int) -> str:
    text = f"{value:.{decimals}f}"
    text = text.rstrip("0").rstrip(".") if decimals else text
    return "0" if text == "-0" else text
