"""The plan of a run covers what is left, each item once, whatever the workers do."""

import numpy as np
import pytest

from maira_qp.errors import JobError
from maira_qp.scale.plan import ATTEMPTS, FIRST_UNITS, MOST_UNITS, SECONDS, Plan
from maira_qp.scale.shards import Shard


def taken(plan: Plan, seconds_per_item: float) -> list[Shard]:
    shards = []
    while (shard := plan.take()) is not None:
        shards.append(shard)
        plan.done(shard, shard.length * seconds_per_item)
    return shards


@pytest.mark.parametrize("size", [None, 1, 7, 1000])
@pytest.mark.parametrize("seconds_per_item", [1e-6, 1e-3, 100.0])
def test_each_item_of_the_gaps_is_taken_once(size, seconds_per_item):
    gaps = [Shard(0, 13), Shard(20, 20), Shard(50, 400)]
    shards = taken(Plan(gaps, size=size, workers=3, units_per_item=1000), seconds_per_item)
    items = np.concatenate([np.arange(*shard) for shard in shards])
    assert sorted(items.tolist()) == [*range(13), *range(50, 400)]


def test_shards_grow_towards_the_time_that_they_are_to_take_and_shrink_at_the_end():
    lengths = [shard.length for shard in taken(Plan([Shard(0, 10**8)], workers=2), 1e-4)]
    assert lengths[0] == FIRST_UNITS
    assert max(lengths) == pytest.approx(SECONDS / 1e-4, rel=0.01)
    assert lengths[-1] < max(lengths) / 4
    assert max(shard.length for shard in taken(Plan([Shard(0, 10**9)]), 1e-9)) == MOST_UNITS


def test_items_that_take_longer_than_thought_come_in_shorter_shards():
    plan = Plan([Shard(0, 10**6)], size=None)
    first = plan.take()
    plan.done(first, 50 * SECONDS)
    assert plan.take().length == pytest.approx(first.length / 50, rel=0.01)


def test_a_shard_that_failed_is_taken_again_and_not_for_ever():
    plan = Plan([Shard(0, 10)], size=5)
    shard = plan.take()
    for _ in range(ATTEMPTS - 1):
        plan.failed(shard, "it was killed")
        assert plan.take() == shard
    with pytest.raises(JobError, match=r"items 0 to 4 failed 3 times: it was killed"):
        plan.failed(shard, "it was killed")
