"""The plan of a run: what is left to do, cut into shards as workers ask for them.

Shards begin short and grow until each takes some seconds, as measured; towards the end they become shorter again, so
that no worker waits long for another. No result depends on how the items are cut.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable

from maira_qp.errors import JobError
from maira_qp.scale.shards import Shard

SECONDS = 20.0
"""What a shard is to take."""
FIRST_UNITS, MOST_UNITS = 20_000, 2_000_000
"""Units (poses) of the first shards, and of any: the latter bounds the memory of a worker."""
GROWTH = 4.0
"""By how much a shard may be longer than those that are done."""
ROUNDS = 3
"""What is left is cut so that each worker has so many shards, if they are not shorter than the first ones then."""
ATTEMPTS = 3
"""How often a shard is tried."""


class Plan:
    """What is left of a job."""

    def __init__(
        self,
        gaps: Iterable[Shard],
        *,
        units_per_item: int = 1,
        workers: int = 1,
        size: int | None = None,
        parts: str = "items",
    ) -> None:
        """The ranges to do, for so many workers; `size` items a shard, or None: as many as the time makes sensible;
        `parts` is what messages call them."""
        self.parts = parts
        self._gaps, self._again = deque(gap for gap in gaps if gap.length > 0), deque[Shard]()
        self._left = sum(gap.length for gap in self._gaps)
        self._workers, self._size = workers, size
        self._least = max(1, FIRST_UNITS // units_per_item)
        self._most = max(1, MOST_UNITS // units_per_item)
        self._longest = float(self._least)
        self._attempts: Counter[Shard] = Counter()

    @property
    def is_empty(self) -> bool:
        """Whether nothing is left to take."""
        return not self._gaps and not self._again

    def take(self) -> Shard | None:
        """A shard to do now; None if nothing is left."""
        if self._again:
            return self._again.popleft()
        if not self._gaps:
            return None
        gap = self._gaps.popleft()
        count = min(gap.length, self._length())
        if count < gap.length:
            self._gaps.appendleft(Shard(gap.first + count, gap.last))
        self._left -= count
        return Shard(gap.first, gap.first + count)

    def done(self, shard: Shard, seconds: float) -> None:
        """Note that a shard is done, and how long it took."""
        wanted = shard.length * min(GROWTH, SECONDS / max(seconds, 1e-9))
        self._longest = min(max(self._longest if seconds < SECONDS else 1.0, wanted), self._most)

    def failed(self, shard: Shard, reason: str) -> None:
        """Note that who did a shard is no more: it is taken again. Raises `JobError` when it was tried often enough."""
        self._attempts[shard] += 1
        if self._attempts[shard] >= ATTEMPTS:
            items = f"the {self.parts} {shard.first} to {shard.last - 1}"
            raise JobError(f"{items} failed {ATTEMPTS} times: {reason}; all else that was done is kept")
        self._again.append(shard)

    def _length(self) -> int:
        if self._size is not None:
            return self._size
        fair = max(-(-self._left // (ROUNDS * self._workers)), self._least)
        return max(1, min(int(self._longest), fair))
