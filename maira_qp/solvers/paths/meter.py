"""How much of a path's work is done, for whoever waits for it, or wants to leave."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[int, int], object]
"""Takes how many poses are done, and how many there are."""


class Meter:
    """Reports the work as poses that are done, never fewer than before; stages of it have shares of the whole.

    What the callback raises, Ctrl-C for one, is raised where the work stands.
    """

    def __init__(self, progress: Progress | None, count: int) -> None:
        """For a path of `count` poses; None: nobody asks."""
        self._progress, self._count, self._share = progress, count, 0.0

    def reach(self, share: float) -> None:
        """So much of the work is done, 0 to 1."""
        self._share = max(self._share, min(share, 1.0))
        self.beat()

    def beat(self) -> None:
        """The work goes on."""
        if self._progress is not None:
            self._progress(int(self._share * self._count), self._count)

    def stage(self, begin: float, end: float) -> Progress:
        """Takes what is done of a stage, and what there is of it: the work from one share to another."""
        return lambda done, total: self.reach(begin + (end - begin) * done / max(total, 1))
