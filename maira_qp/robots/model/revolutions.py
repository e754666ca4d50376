"""Joint angles that differ by whole turns: the same pose of every link, but another place between the limits."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np

from maira_qp.robots.model.robot import Robot

WITHIN = 1e-9
"""A joint beyond a limit by at most this [rad or m] is at the limit: it is clipped."""
FARTHEST = 1e4
"""Turns are counted to no place farther from zero [rad]: there numbers become too coarse for an angle."""
TURN = 2 * np.pi


@dataclass(frozen=True, eq=False)
class WholeTurns:
    """The turns of a robot's joints, counted to stay near a reference."""

    robot: Robot
    reference: np.ndarray
    """(n,) [rad or m]"""

    @cached_property
    def revolute(self) -> np.ndarray:
        """Which joints (n,) turn."""
        return ~self.robot.slides

    @cached_property
    def everywhere(self) -> np.ndarray:
        """Which joints (n,) have every angle within their limits: their range is a turn or more."""
        return np.asarray(self.revolute & (self.robot.upper - self.robot.lower >= TURN))

    @cached_property
    def long_slides(self) -> np.ndarray:
        """Which joints (n,) slide more than twice the arm's length: a search places them by its target."""
        return np.asarray(self.robot.slides & (self.robot.upper - self.robot.lower > 2 * self.robot.length))

    @cached_property
    def aim(self) -> np.ndarray:
        """The reference (n,), or where that is beyond numbers fine enough the farthest place."""
        return np.clip(self.reference, -FARTHEST, FARTHEST)

    @cached_property
    def window(self) -> tuple[np.ndarray, np.ndarray]:
        """What is sampled of the limits, (n,) and (n,): of joints with a turn or more the turn around the reference.

        Of `long_slides` the arm's length on either side of it.
        """
        lower, upper = self.robot.lower, self.robot.upper
        cut = self.everywhere | self.long_slides
        if not cut.any():
            return lower, upper
        half = np.where(self.robot.slides, self.robot.length, 0.5 * TURN)
        middle = np.clip(self.aim, lower + half, upper - half)
        first, last = np.maximum(middle - half, lower), np.minimum(middle + half, upper)
        return np.where(cut, first, lower), np.where(cut, last, upper)

    def around(self, turns: int) -> tuple[np.ndarray, np.ndarray]:
        """The limits (n,) and (n,) with no joint more than so many turns away from `window`; continuous ones stay."""
        first, last = self.window
        cut = self.everywhere & np.isfinite(self.robot.lower)
        lower, upper = (
            np.maximum(first - turns * TURN, self.robot.lower),
            np.minimum(last + turns * TURN, self.robot.upper),
        )
        return np.where(cut, lower, self.robot.lower), np.where(cut, upper, self.robot.upper)

    def unwound(self, q: np.ndarray) -> np.ndarray:
        """The configuration (n,) with the turns taken off that `everywhere` joints have made."""
        return q - np.where(self.everywhere, TURN * np.round(q / TURN), 0.0)

    def shortest(self, difference: np.ndarray) -> np.ndarray:
        """Differences (..., n) without the whole turns of `everywhere` joints."""
        return difference - np.where(self.everywhere, TURN * np.round(difference / TURN), 0.0)

    def turns_for(self, least: np.ndarray, most: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The least and the largest number of turns (..., n) that keep a travel within limits; others have 0 and 0."""
        below, above = self.robot.lower - WITHIN - least, self.robot.upper + WITHIN - most
        first, last = np.ceil(below / TURN), np.floor(above / TURN)
        return np.where(self.everywhere, first, 0.0 + (below > 0)), np.where(self.everywhere, last, 0.0 - (above < 0))

    def room_for(self, least: np.ndarray, most: np.ndarray) -> np.ndarray:
        """Whole turns (n,) [rad] that put a travel from (n,) to (n,) between the limits, about in their middle."""
        first, last = self.turns_for(least, most)
        middle = 0.5 * (self.window[0] + self.window[1])
        return TURN * np.minimum(np.maximum(np.round((middle - 0.5 * (least + most)) / TURN), first), last)

    def room_near(self, least: np.ndarray, most: np.ndarray, shift: np.ndarray) -> np.ndarray:
        """The same, of them those that are nearest to a shift (n,)."""
        first, last = self.turns_for(least, most)
        return TURN * np.minimum(np.maximum(np.round(shift / TURN), first), last)

    def in_window(self, q: np.ndarray) -> np.ndarray:
        """Configurations (..., n) with `everywhere` joints at the turn that is sampled, see `window`."""
        first, last = self.window
        middle = np.where(self.everywhere, 0.5 * (first + last), 0.0)
        return middle + self.shortest(q - middle)

    def apart(self, q: np.ndarray, others: np.ndarray) -> np.ndarray:
        """How far (...) [rad or m] q and others (..., n) are apart in the joint that differs most, turns aside."""
        d = self.robot.kinematics.difference(q, others)
        return np.abs(d - np.where(self.revolute, TURN * np.round(d / TURN), 0.0)).max(axis=-1, initial=0.0)

    def within(self, q: np.ndarray, slack: float = WITHIN) -> np.ndarray:
        """Those of the configurations (k, n) that turns bring within the limits, as near the reference as they can.

        (m, n), within the limits exactly: what is beyond them by at most `slack` [rad or m] is clipped.
        """
        first, last = self._room(q, slack)
        turns = np.clip(np.round((self.aim - q) / TURN), first, last)
        fits = (first <= last).all(axis=-1)
        return np.clip((q + TURN * turns)[fits], self.robot.lower, self.robot.upper)

    def all_within(self, q: np.ndarray, most: int) -> tuple[np.ndarray, bool]:
        """All (k, n) that are some q (m, n) but for whole turns and within the limits, and whether these are all.

        Of a continuous joint only the angle nearest to the reference is taken. Where there would be more than `most`,
        what is left out has the most turns away from the reference.
        """
        shares = [self._each_within(each, max(most // len(q), 1)) for each in q]
        listed = np.concatenate([np.empty((0, self.robot.n)), *(share for share, _ in shares)])
        return listed, all(complete for _, complete in shares)

    def _each_within(self, q: np.ndarray, most: int) -> tuple[np.ndarray, bool]:
        """`all_within` of one configuration (n,)."""
        rooms = list(zip(*self._room(q), strict=True))
        angles = [self._angles(i, q[i], *room, most) for i, room in enumerate(rooms)]
        within = all(np.isinf(last) or last - first < most for first, last in rooms)
        chosen, complete = first_choices(angles, most)
        return np.clip(chosen.reshape(-1, self.robot.n), self.robot.lower, self.robot.upper), within and complete

    def _angles(self, joint: int, angle: float, first: float, last: float, most: int) -> np.ndarray:
        """The angles (k,) [rad] of a joint that are `first` to `last` turns further, nearest to the reference first.

        At most so many; a continuous joint has the first of them alone.
        """
        nearest = np.round((self.aim[joint] - angle) / TURN)
        if np.isinf(last):
            return np.array([angle + TURN * nearest])
        turns = np.clip(nearest, first, last) + np.arange(-most, most + 1)
        turns = turns[(first <= turns) & (turns <= last)]
        return angle + TURN * turns[np.argsort(np.abs(turns - nearest), kind="stable")][:most]

    def _room(self, q: np.ndarray, slack: float = WITHIN) -> tuple[np.ndarray, np.ndarray]:
        """The fewest and the most turns (..., n) that keep q (..., n) within the limits; none do where they cross."""
        lower, upper = self.robot.lower - slack, self.robot.upper + slack
        first, last = np.ceil((lower - q) / TURN), np.floor((upper - q) / TURN)
        return np.where(self.revolute, first, 1.0 * (q < lower)), np.where(self.revolute, last, -1.0 * (q > upper))


def first_choices(choices: list[np.ndarray], most: int) -> tuple[np.ndarray, bool]:
    """All combinations (k, n) of one of the choices (m_i,) for each of n, and whether these are all.

    Where there are more than `most`, the last of the choices are left out, where there are the most of them.
    """
    counts = np.array([len(each) for each in choices])
    complete = bool(np.prod(counts, dtype=float) <= most)
    while np.prod(counts, dtype=float) > max(most, 1):
        counts[counts.argmax()] -= 1
    chosen = product(*(each[:count] for each, count in zip(choices, counts, strict=True)))
    return np.reshape(list(chosen), (-1, len(choices))), complete
