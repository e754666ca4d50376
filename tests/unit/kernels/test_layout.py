"""The columns of the kernels' arrays: names that kernels and Python read alike, and that do not overlap."""

import numpy as np
import pytest

from maira_qp.kernels import layout
from maira_qp.kernels.jit.columns import Columns
from maira_qp.kernels.jit.decorators import kernel

WHOLE_ROWS = (
    *(layout.Setting, layout.Descent, layout.Slot, layout.Lane, layout.Settling, layout.Refinement, layout.Walk),
    *(layout.Step, layout.Clipped, layout.Range, layout.Limit, layout.Arc, layout.Pivot),
)
"""Groups whose columns are a number each."""


class Pair(Columns):
    """Two columns and a number that stands in them."""

    LEFT, RIGHT = 1, 0
    WIDTH = 2
    NOTHING = -1.0


@kernel
def swapped(row, out):
    for i in range(Pair.WIDTH):
        out[i] = Pair.NOTHING
    out[Pair.LEFT], out[Pair.RIGHT] = row[Pair.RIGHT], row[Pair.LEFT]


def test_a_kernel_reads_columns_as_python_does():
    out = np.empty(2)
    swapped(np.array([1.0, 2.0]), out)
    assert out.tolist() == [2.0, 1.0]


@pytest.mark.parametrize("group", WHOLE_ROWS, ids=lambda group: group.__name__)
def test_every_column_has_one_name_and_none_is_past_the_end(group):
    named = [value for name, value in inherited(group).items() if name.isupper() and name != "WIDTH"]
    assert sorted(named) == list(range(group.WIDTH))


def inherited(group: type) -> dict:
    return {name: value for kind in reversed(group.__mro__) for name, value in vars(kind).items()}


def test_rows_are_made_by_name():
    assert Pair.row(RIGHT=3.0, LEFT=4.0).tolist() == [3.0, 4.0]
    assert np.isnan(Pair.row(LEFT=4.0)[Pair.RIGHT])
    with pytest.raises(AttributeError, match="CENTRE"):
        Pair.row(CENTRE=1.0)


def test_what_stands_in_a_row_ends_where_the_next_begins():
    assert layout.Spherical.LIMITS == layout.Spherical.RANGES + 3 * layout.Range.WIDTH
    assert layout.Spherical.WIDTH == layout.Spherical.LIMITS + 6 * layout.Limit.WIDTH
    assert layout.TaskRow.TARGET == layout.TaskRow.PLACEMENTS + 3 * 12
    assert layout.Place.WIDTH == layout.Place.JOINTS + 3
    assert layout.Joint.TREE_WIDTH == layout.Joint.ACCELERATION + 1 == layout.Joint.WIDTH + 2
