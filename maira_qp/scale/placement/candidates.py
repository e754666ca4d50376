"""The bases that are compared: a grid of positions and of yaw angles, in the frame that the tool poses are given in."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from maira_qp.arrays import is_listing, is_number
from maira_qp.errors import OptionError, shown

MOST = 10_000_000
"""Most bases that are compared."""
WHOLE = 1e-9
"""Share of a step by which a range may be longer than a whole number of steps."""
TURN = 2.0 * math.pi


@dataclass(frozen=True, eq=False)
class Candidates:
    """All combinations of some x, y, z [m] and yaw angles [rad], the yaw counted fastest."""

    axes: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
    """Values of x, y, z and yaw, in order"""

    @staticmethod
    def of(x: Any, y: Any, z: Any, yaw: Any, step: float, turn: float) -> Candidates:
        """A grid over ranges, each a number or (lower, upper), at most `step` [m] and `turn` [rad] fine.

        A range of yaw of a whole turn has its end only once. Raises `OptionError`.
        """
        ranges = [ends(value, name) for value, name in ((x, "x"), (y, "y"), (z, "z"), (yaw, "yaw"))]
        if ranges[3][1] - ranges[3][0] > TURN * (1.0 + WHOLE):
            raise OptionError(f"yaw must be a range of at most a turn, got {shown(yaw)}")
        steps = [step, step, step, turn]
        counts = [_count(low, high, each) for (low, high), each in zip(ranges, steps, strict=True)]
        if math.prod(counts) > MOST:
            size = " x ".join(f"{count:.6g}" for count in counts)
            raise OptionError(f"{size} bases are too many, at most {MOST} are compared: make step or turn larger")
        axes = [np.linspace(low, high, int(count)) for (low, high), count in zip(ranges, counts, strict=True)]
        if ranges[3][1] - ranges[3][0] >= TURN * (1.0 - WHOLE):
            axes[3] = axes[3][:-1]
        return Candidates((axes[0], axes[1], axes[2], axes[3]))

    @property
    def shape(self) -> tuple[int, ...]:
        """How many x, y, z and yaw angles."""
        return tuple(map(len, self.axes))

    def __len__(self) -> int:
        return math.prod(self.shape)

    def values(self, index: Sequence[int] | np.ndarray) -> np.ndarray:
        """x, y, z [m] and yaw [rad] (M, 4) of bases, by their indices."""
        places = np.unravel_index(np.asarray(index, dtype=np.int64), self.shape)
        return np.column_stack([axis[place] for axis, place in zip(self.axes, places, strict=True)])


def check_steps(step: Any, turn: Any) -> None:
    """Raises `OptionError` for steps [m] and [rad] that are not positive."""
    for name, value in (("step", step), ("turn", turn)):
        if not (is_number(value) and 0 < value < math.inf):
            raise OptionError(f"{name} must be a positive number, got {shown(value)}")


def poses_of_bases(values: np.ndarray) -> np.ndarray:
    """The poses (M, 4, 4) of bases, from x, y, z [m] and yaw [rad] (M, 4)."""
    T = np.tile(np.eye(4), (len(values), 1, 1))
    c, s = np.cos(values[:, 3]), np.sin(values[:, 3])
    T[:, 0, 0], T[:, 0, 1], T[:, 1, 0], T[:, 1, 1] = c, -s, s, c
    T[:, :3, 3] = values[:, :3]
    return T


def seen_from(bases: np.ndarray, poses: np.ndarray) -> np.ndarray:
    """Poses (N, 4, 4) relative to each of bases (M, 4, 4), (M, N, 4, 4)."""
    R = bases[:, :3, :3].swapaxes(1, 2)
    T = np.zeros((len(bases), len(poses), 4, 4))
    T[..., :3, :3] = R[:, None] @ poses[:, :3, :3]
    T[..., :3, 3] = np.einsum("mij,mnj->mni", R, poses[:, :3, 3] - bases[:, None, :3, 3])
    T[..., 3, 3] = 1.0
    return T


def ends(value: Any, name: str) -> tuple[float, float]:
    """Both ends of a range, which are one for a number. Raises `OptionError`."""
    given = [value, value] if is_number(value) else list(value) if is_listing(value) else []
    given = given * 2 if len(given) == 1 else given
    fits = len(given) == 2 and all(is_number(each) and math.isfinite(each) for each in given)
    if not fits or not given[0] <= given[1]:
        raise OptionError(f"{name} must be a number or a range, the lower end first, got {shown(value)}")
    return float(given[0]), float(given[1])


def _count(low: float, high: float, step: float) -> float:
    """How many values a range has; a float, for it may be beyond all bounds."""
    return math.ceil(min((high - low) / step, 1e300) * (1.0 - WHOLE)) + 1
