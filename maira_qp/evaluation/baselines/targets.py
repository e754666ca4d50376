"""Targets for experiments, drawn at random."""

from __future__ import annotations

from typing import Any

import numpy as np

from maira_qp.arrays import real_array
from maira_qp.errors import OptionError


def sample_target(bounds: Any, rng: np.random.Generator) -> np.ndarray:
    """A point (3,) [m], uniform in the box `bounds` (3, 2): the least and the greatest x, y and z.

    Raises `OptionError` if a bound is above its partner. The point need not be reachable.
    """
    bounds = real_array(bounds, (3, 2), "bounds", OptionError)
    if not (bounds[:, 0] <= bounds[:, 1]).all():
        raise OptionError(f"each row of bounds must be (least, greatest), got {bounds.tolist()}")
    return rng.uniform(bounds[:, 0], bounds[:, 1])
