"""Every operation on lanes is that of NumPy: in eight lanes, on one number, and between the two."""

import numpy as np
import pytest
from numba import njit

from maira_qp.kernels.jit.simd import (
    LANES,
    any_lane,
    broadcast,
    floor,
    load,
    load2,
    magnitude,
    maximum,
    minimum,
    select,
    square_root,
    store,
    store2,
)

pytestmark = pytest.mark.xdist_group("lanes")  # the helpers compile once

SPECIAL = [0.0, -0.0, 1.0, -1.0, 2.5, -2.5, 0.5, 3.0, np.pi, 5e-324, 1e-300, 1e308, -1.7e308, np.inf, -np.inf, np.nan]


@njit(error_model="numpy")
def everything_of_two(x, y, out):
    """Each operation of two values into a row of its own, a mask as 1 and 0."""
    store(out, 0, x + y)
    store(out, 1, x - y)
    store(out, 2, x * y)
    store(out, 3, x / y)
    store(out, 4, select(x < y, 1.0, 0.0))
    store(out, 5, select(x <= y, 1.0, 0.0))
    store(out, 6, select(x > y, 1.0, 0.0))
    store(out, 7, select(x >= y, 1.0, 0.0))
    store(out, 8, select(x == y, 1.0, 0.0))
    store(out, 9, select(x != y, 1.0, 0.0))
    store(out, 10, minimum(x, y))
    store(out, 11, maximum(x, y))
    store(out, 12, select(x < y, x, y))
    store(out, 13, select((x <= y) & (x >= y), 1.0, 0.0))
    store(out, 14, select((x < y) | (x > y), 1.0, 0.0))


def numpy_of_two(x, y):
    """The same by NumPy (15, ...)."""
    rows = [x + y, x - y, x * y, x / y, x < y, x <= y, x > y, x >= y, x == y, x != y]
    rows += [np.where(x < y, x, y), np.where(x > y, x, y), np.where(x < y, x, y)]
    rows += [(x <= y) & (x >= y), (x < y) | (x > y)]
    return np.array(np.broadcast_arrays(*rows), dtype=float)


@njit(error_model="numpy")
def everything_of_one(x, out):
    store(out, 0, -x)
    store(out, 1, square_root(x))
    store(out, 2, magnitude(x))
    store(out, 3, floor(x))
    store(out, 4, select(x > 0.0, 1.0, 0.0))


def numpy_of_one(x):
    return np.array([-x, np.sqrt(x), np.abs(x), np.floor(x), x > 0])


@njit(error_model="numpy")
def two(a, b, i, out):
    everything_of_two(load(a, i), load(b, i), out)


@njit(error_model="numpy")
def left_number(x, b, i, out):
    everything_of_two(x, load(b, i), out)


@njit(error_model="numpy")
def right_number(a, y, i, out):
    everything_of_two(load(a, i), y, out)


@njit(error_model="numpy")
def one(a, i, out):
    everything_of_one(load(a, i), out)


def assert_identical(found, expected) -> None:
    """Equal, signs of zeros too; NaN equals NaN."""
    np.testing.assert_array_equal(found, expected)
    numbers = ~np.isnan(expected)
    np.testing.assert_array_equal(np.signbit(found)[numbers], np.signbit(expected)[numbers])


@pytest.fixture
def pairs(rng):
    """Every pair of special values, and random ones, eight in a row: (K, 8) twice."""
    x, y = (v.ravel() for v in np.meshgrid(SPECIAL, SPECIAL))
    more = rng.normal(size=(2, 20 * LANES)) * 10.0 ** rng.integers(-12, 12, (2, 20 * LANES))
    x, y = np.concatenate([[x, y], more], axis=1)
    order = rng.permutation(len(x))  # so that every lane sees each kind of value
    return x[order].reshape(-1, LANES), y[order].reshape(-1, LANES)


@np.errstate(all="ignore")
def test_operations_of_two_are_numpys_in_every_lane(pairs):
    x, y = pairs
    for i in range(len(x)):
        out = np.full((15, LANES), 7.0)
        two(x, y, i, out)
        assert_identical(out, numpy_of_two(x[i], y[i]))


@np.errstate(all="ignore")
def test_operations_of_two_are_numpys_on_one_number(pairs):
    x, y = (v.ravel() for v in pairs)
    for i in range(len(x)):
        out = np.full(15, 7.0)
        two(x, y, i, out)
        assert_identical(out, numpy_of_two(x[i], y[i]))


@np.errstate(all="ignore")
@pytest.mark.parametrize("number", [*SPECIAL, 3, -1, 0], ids=repr)
def test_a_number_stands_for_itself_in_every_lane_on_either_side(pairs, number):
    """A float or an integer."""
    x, y = pairs
    for i in range(len(x)):
        out = np.full((15, LANES), 7.0)
        left_number(number, y, i, out)
        assert_identical(out, numpy_of_two(np.float64(number), y[i]))
        right_number(x, number, i, out)
        assert_identical(out, numpy_of_two(x[i], np.float64(number)))


@np.errstate(all="ignore")
def test_operations_of_one_are_numpys_in_every_lane_and_on_one_number(pairs):
    x, _ = pairs
    for i in range(len(x)):
        out = np.full((5, LANES), 7.0)
        one(x, i, out)
        assert_identical(out, numpy_of_one(x[i]))
    x = x.ravel()
    for i in range(len(x)):
        out = np.full(5, 7.0)
        one(x, i, out)
        assert_identical(out, numpy_of_one(x[i]))


@njit
def of_masks(a, b, out):
    x, y = load(a, 0) > 0.0, load(b, 0) > 0.0
    store(out, 0, select(x & y, 1.0, 0.0))
    store(out, 1, select(x | y, 1.0, 0.0))
    store(out, 2, select(~x, 1.0, 0.0))
    store(out, 3, select(x & ~y, load(a, 0), load(b, 0)))
    return any_lane(x), any_lane(x & y), any_lane(~x)


def test_masks_are_joined_turned_and_asked_lane_by_lane():
    """All 256 masks."""
    for bits in range(2**LANES):
        x = (bits >> np.arange(LANES)) & 1 > 0
        y = np.roll(x, 1) ^ (bits % 3 == 0)
        a, b, out = np.where(x, 2.0, -3.0)[None], np.where(y, 5.0, -7.0)[None], np.empty((4, LANES))
        asked = of_masks(a, b, out)
        np.testing.assert_array_equal(out, [x & y, x | y, ~x, np.where(x & ~y, a[0], b[0])])
        assert asked == (x.any(), (x & y).any(), (~x).any())


@pytest.mark.parametrize("x", [2.0, -2.0])
@pytest.mark.parametrize("y", [3.0, -3.0])
def test_one_truth_value_is_a_mask_of_one(x, y):
    out = np.empty(4)
    asked = of_masks(np.array([x]), np.array([y]), out)
    assert out.tolist() == [x > 0 and y > 0, x > 0 or y > 0, x <= 0, x if x > 0 and y <= 0 else y]
    assert asked == (x > 0, x > 0 and y > 0, x <= 0)


@njit
def copy_entries(a, b, out1, out2):
    for i in range(a.shape[0]):
        store(out1, i, load(a, i))
    for i in range(b.shape[0]):
        for j in range(b.shape[1]):
            store2(out2, i, j, load2(b, i, j))


@njit
def fill(like, out, out2, value):
    for i in range(3):
        store(out, i, broadcast(like, value))
        for j in range(2):
            store2(out2, i, j, value)


@pytest.mark.parametrize("lanes", [(), (LANES,)], ids=["one", "eight"])
def test_entries_are_read_and_written_where_they_stand(lanes, rng):
    """And nowhere else: beside the array nothing changes."""
    a, b = rng.normal(size=(5, *lanes)), rng.normal(size=(4, 3, *lanes))
    large1, large2 = np.full((7, *lanes), 9.0), np.full((6, 3, *lanes), 9.0)
    copy_entries(a, b, large1[1:6], large2[1:5])
    np.testing.assert_array_equal(large1[1:6], a)
    np.testing.assert_array_equal(large2[1:5], b)
    for beside in (large1[0], large1[6], large2[0], large2[5]):
        assert (beside == 9.0).all()


@pytest.mark.parametrize("lanes", [(), (LANES,)], ids=["one", "eight"])
@pytest.mark.parametrize("value", [2.5, 3, np.nan])
def test_a_number_is_written_into_every_lane(lanes, value):
    out, out2 = np.empty((3, *lanes)), np.empty((3, 2, *lanes))
    fill(out, out, out2, value)
    np.testing.assert_array_equal(out, np.full_like(out, value))
    np.testing.assert_array_equal(out2, np.full_like(out2, value))


@njit
def keeps_what_was_read(a):
    x = load(a, 0)
    store(a, 0, x + 1.0)
    store(a, 1, x)


@pytest.mark.parametrize("lanes", [(), (LANES,)], ids=["one", "eight"])
def test_what_was_read_does_not_change_with_the_array(lanes, rng):
    before = rng.normal(size=(2, *lanes))
    a = before.copy()
    keeps_what_was_read(a)
    np.testing.assert_array_equal(a, [before[0] + 1.0, before[0]])


@njit
def mixed_choice(a, out):
    x = load(a, 0)
    store(out, 0, select(x > 0.0, x, 4.0))
    store(out, 1, select(x > 0.0, 4.0, x))
    store(out, 2, select(x > 0.0, 4, 5))
    store(out, 3, maximum(x, 1))
    store(out, 4, minimum(1, x))


@pytest.mark.parametrize("lanes", [(), (LANES,)], ids=["one", "eight"])
def test_choices_take_numbers_of_either_kind(lanes, rng):
    for _ in range(5):
        a, out = rng.normal(size=(1, *lanes)), np.empty((5, *lanes))
        mixed_choice(a, out)
        x = a[0]
        by_twin = [np.where(x > 0, x, 4), np.where(x > 0, 4, x), np.where(x > 0, 4, 5), np.maximum(x, 1)]
        np.testing.assert_array_equal(out, [*by_twin, np.minimum(1, x)])
