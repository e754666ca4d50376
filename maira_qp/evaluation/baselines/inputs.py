"""Arguments of the reference methods, checked once before the first iteration."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from maira_qp.arrays import is_count, is_number
from maira_qp.errors import OptionError, shown


def positive(value: Any, name: str, *, infinite: bool = False) -> float:
    """A number > 0, finite unless `infinite`. Raises `OptionError`."""
    if not is_number(value) or not 0 < value <= math.inf or (math.isinf(value) and not infinite):
        raise OptionError(f"{name} must be a positive number, got {shown(value)}")
    return float(value)


def not_negative(value: Any, name: str) -> float:
    """A finite number >= 0. Raises `OptionError`."""
    if not is_number(value) or not 0 <= value < math.inf:
        raise OptionError(f"{name} must be a number that is zero or more, got {shown(value)}")
    return float(value)


def count(value: Any, name: str) -> int:
    """A whole number >= 0. Raises `OptionError`."""
    if not is_count(value) or isinstance(value, (float, np.floating)):
        raise OptionError(f"{name} must be a whole number, zero or more, got {shown(value)}")
    return int(value)
