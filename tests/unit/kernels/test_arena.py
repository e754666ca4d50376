"""Scratch memory: the arrays of an arena lie beside each other, and take all of it."""

import pkgutil
import sys
from importlib import import_module

import numpy as np
import pytest
from support.compiled_problems import rubbish

import maira_qp.kernels
from maira_qp.kernels.jit.arena import Arena
from maira_qp.kernels.jit.decorators import kernel
from maira_qp.kernels.jit.simd import LANES, store
from maira_qp.kernels.layout import Descent
from maira_qp.kernels.search.levenberg_marquardt import LANES_ARENA, make_lanes

MIXED = Arena("Mixed", "n m", floats={"H": "n, max(m, n)", "v": "2 * m + 1"}, integers={"side": "n", "index": "3, m"})
Mixed, carve_mixed, make_mixed = MIXED.Arrays, MIXED.carve, MIXED.make
WIDE = Arena("Wide", "n", lanes=True, floats={"state": "3", "q": "n", "A": "n, n"})
Wide, carve_wide = WIDE.Arrays, WIDE.carve


def arenas() -> list[Arena]:
    """Those of all kernels."""
    names = (found.name for found in pkgutil.walk_packages(maira_qp.kernels.__path__, "maira_qp.kernels."))
    every = [arena for name in names for arena in vars(import_module(name)).values() if isinstance(arena, Arena)]
    return list(dict.fromkeys(every))


def is_whole(arrays, memory: np.ndarray, slack: int = 0) -> bool:
    """The arrays lie in the memory, each where the one before ends, from its begin to its end but for some numbers."""
    begin, end = memory.ctypes.data, memory.ctypes.data + memory.nbytes
    begins = [each.ctypes.data for each in arrays]
    ends = [each.ctypes.data + each.nbytes for each in arrays]
    assert all(each.flags.c_contiguous and each.dtype == memory.dtype for each in arrays)
    return begins[1:] == ends[:-1] and begin <= begins[0] <= begin + 8 * slack and end - 8 * slack <= ends[-1] <= end


@pytest.mark.parametrize("arena", arenas(), ids=lambda arena: arena.Arrays.__name__)
@pytest.mark.parametrize("dimensions", [(1, 1, 1, 1), (7, 2, 12, 3), (9, 3, 4, 2)])
def test_arrays_take_all_of_their_memory_each_for_itself(arena, dimensions):
    dimensions = dimensions[: len(arena.dimensions)]
    memories = rubbish(arena, *dimensions)
    arrays = arena.plain(*dimensions, *memories)
    assert tuple(memory.size for memory in memories) == arena.sizes(*dimensions)[: len(memories)]
    slack = LANES - 1 if arena.lanes else 0
    for memory in memories:
        assert is_whole([each for each in arrays if each.dtype == memory.dtype], memory, slack)
    with pytest.raises(ValueError, match="reshape"):
        arena.plain(*dimensions, *(memory[: -1 - slack] for memory in memories))


@pytest.mark.parametrize("arena", arenas(), ids=lambda arena: arena.Arrays.__name__)
def test_the_type_of_an_arenas_arrays_can_be_kept_on_disk(arena):
    assert getattr(sys.modules[arena.Arrays.__module__], arena.Arrays.__name__) is arena.Arrays


@kernel
def fill(n, m, floats, integers, shapes):
    """Write into each array of `MIXED` its own number everywhere."""
    work = carve_mixed(n, m, floats, integers)
    for i in range(work.H.shape[0]):
        for j in range(work.H.shape[1]):
            work.H[i, j] = 1.0
        work.side[i] = 3
    for i in range(len(work.v)):
        work.v[i] = 2.0
    for i in range(3):
        for j in range(m):
            work.index[i, j] = 4
    shapes[0], shapes[1] = work.H.shape
    shapes[2], shapes[3] = len(work.v), len(work.side)
    shapes[4], shapes[5] = work.index.shape


@pytest.mark.parametrize(("n", "m"), [(1, 1), (2, 5), (4, 3)])
def test_a_kernel_has_arrays_of_the_shapes_that_are_declared(n, m):
    """As they are in plain Python, and with what is written into one nowhere else."""
    floats, integers = np.full(n * max(m, n) + 2 * m + 5, np.nan), np.full(n + 3 * m + 4, -7)
    shapes = np.zeros(6, np.int64)
    fill(n, m, floats[2:-2], integers[2:-2], shapes)
    assert MIXED.sizes(n, m) == (len(floats) - 4, len(integers) - 4)
    assert shapes.tolist() == [n, max(m, n), 2 * m + 1, n, 3, m]
    assert np.isnan(floats[[0, 1, -2, -1]]).all()
    assert (integers[[0, 1, -2, -1]] == -7).all()
    seen = MIXED.plain(n, m, floats[2:-2], integers[2:-2])
    for number, array in enumerate(seen, 1):
        assert (array == number).all()


@kernel
def number(n, floats):
    """Write into each array of `WIDE` its own number everywhere."""
    work = carve_wide(n, floats)
    for i in range(3):
        store(work.state, i, 1.0)
    for i in range(n):
        store(work.q, i, 2.0)
        for j in range(n):
            for lane in range(LANES):
                work.A[i, j, lane] = 3.0


@pytest.mark.parametrize("offset", range(LANES))
def test_arrays_with_lanes_begin_on_lines_of_the_cache_wherever_the_memory_begins(offset):
    n = 3
    floats = np.full(WIDE.sizes(n)[0] + LANES, np.nan)
    memory = floats[offset : offset + WIDE.sizes(n)[0]]
    number(n, memory)
    assert np.count_nonzero(~np.isnan(floats)) == (3 + n + n * n) * LANES
    for expected, array in enumerate(WIDE.plain(n, memory), 1):
        assert array.ctypes.data % 64 == 0
        assert (array == expected).all()


@kernel(allocates=True)
def sum_of_made(n, m):
    """Make arrays twice, so that the first may be given back; what is in the second."""
    total = 0.0
    for k in range(2):
        work = make_mixed(n, m)
        for i in range(n):
            total += work.H[i, 0] + work.side[i]
            work.H[i, 0], work.side[i] = 1.0 + k, 1 + k
        for i in range(n):
            total += work.H[i, 0] + work.side[i]
    return total


def test_arrays_that_a_kernel_makes_begin_as_zeros():
    assert sum_of_made(4, 3) == 4 * (2 + 4)


def test_lanes_are_made_with_all_descents_ended():
    n = 2
    memory = rubbish(LANES_ARENA, n)
    make_lanes_from_python(n, *memory)
    assert (LANES_ARENA.plain(n, *memory).state[Descent.ENDED] == 1.0).all()


@kernel
def make_lanes_from_python(n, floats):
    make_lanes(n, floats)
