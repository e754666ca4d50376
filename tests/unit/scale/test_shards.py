"""Shards: whole or absent, known by the job and the range, gathered into blocks that show no seam."""

import pickle

import numpy as np
import pytest

from maira_qp.errors import JobError
from maira_qp.scale.shards import DamagedShard, Shard, Shards


def arrays(shard: Shard) -> dict[str, np.ndarray]:
    index = np.arange(*shard)
    return {"index": index, "pair": np.column_stack([index, -index])}


@pytest.fixture
def shards(tmp_path) -> Shards:
    return Shards(tmp_path, "some job")


def test_what_is_read_is_what_was_written(shards):
    shard = Shard(3, 9)
    shards.write(shard, arrays(shard))
    for name, values in shards.read(shard).items():
        np.testing.assert_array_equal(values, arrays(shard)[name])
    assert shards.there() == [shard]


def test_gaps_are_what_no_shard_answers_where_they_overlap_too(shards):
    assert shards.gaps(0, 30) == [Shard(0, 30)]
    for shard in (Shard(5, 10), Shard(8, 12), Shard(20, 25), Shard(6, 7)):
        shards.write(shard, arrays(shard))
    assert shards.gaps(0, 30) == [Shard(0, 5), Shard(12, 20), Shard(25, 30)]
    assert [gap for gap in shards.gaps(5, 12) if gap.length] == []
    assert shards.gaps(7, 15) == [Shard(12, 15)]


def test_random_coverings_make_the_same_blocks(shards, rng):
    for _ in range(30):
        shards.remove()
        count, block = int(rng.integers(1, 60)), int(rng.integers(1, 20))
        while gaps := [gap for gap in shards.gaps(0, count) if gap.length]:
            first = int(rng.integers(max(0, gaps[0].first - 4), gaps[0].first + 1))
            shard = Shard(first, int(rng.integers(gaps[0].first + 1, count + 1)))
            shards.write(shard, arrays(shard))
        blocks = list(shards.blocks(0, count, block))
        middle = block * int(rng.integers(0, len(blocks)))
        halves = [*shards.blocks(0, middle, block)] if middle else []
        for (first, found), (other, again) in zip([*halves, *shards.blocks(middle, count, block)], blocks, strict=True):
            assert first == other
            np.testing.assert_array_equal(found["pair"], again["pair"])
        assert [first for first, _ in blocks] == list(range(0, count, block))
        for name, wanted in arrays(Shard(0, count)).items():
            np.testing.assert_array_equal(np.concatenate([found[name] for _, found in blocks]), wanted)
            assert all(len(found[name]) == block for _, found in blocks[:-1])


@pytest.mark.parametrize("missing", [Shard(0, 4), Shard(4, 8), Shard(8, 12)])
def test_a_shard_that_is_missing_is_told_not_made_up(shards, missing):
    for shard in {Shard(0, 4), Shard(4, 8), Shard(8, 12)} - {missing}:
        shards.write(shard, {"x": np.arange(*shard)})
    with pytest.raises(JobError, match=f"no shard of the item {missing.first} any more: resume"):
        list(shards.blocks(0, 12, 5))


def test_shards_of_another_job_are_none_of_this_one(shards, tmp_path):
    shard = Shard(0, 4)
    Shards(tmp_path, "another job").write(shard, arrays(shard))
    assert shards.there() == []
    assert shards.gaps(0, 4) == [shard]


@pytest.mark.parametrize("damage", ["cut", "flipped", "empty", "swapped"])
def test_damage_is_found(shards, damage):
    shard = Shard(0, 50)
    shards.write(shard, arrays(shard))
    other = Shard(50, 100)
    shards.write(other, arrays(other))
    swapped = shards.path(other).read_bytes()
    content = bytearray(shards.path(shard).read_bytes())
    content[len(content) // 2] ^= 1
    shards.path(shard).write_bytes({"cut": content[:-1], "flipped": content, "empty": b"", "swapped": swapped}[damage])
    with pytest.raises(DamagedShard, match="checksum") as raised:
        shards.read(shard)
    assert pickle.loads(pickle.dumps(raised.value)).path == shards.path(shard)  # as a worker sends it
    assert list(shards.damaged()) == [shards.path(shard)]
