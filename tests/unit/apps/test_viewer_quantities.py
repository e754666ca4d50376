"""What the viewer's panel says and takes: lengths, angles, poses, sizes, and moments to go back to."""

import numpy as np
import pytest

import maira_qp as mq
from maira_qp.apps.viewer.motion.history import MOST, History, Moment
from maira_qp.apps.viewer.panel.copying import copied_lines
from maira_qp.apps.viewer.panel.solids import KINDS, label_of, resized, sizes_of, solid
from maira_qp.apps.viewer.quantities import (
    angle,
    length,
    listing,
    numbers,
    position_of,
    position_text,
    quaternion_text,
    rotation_of_quaternion,
    rotation_of_rpy,
    rpy_text,
)
from maira_qp.errors import OptionError


def test_lengths_and_angles_are_in_units_that_can_be_read():
    lengths = {0.0: "< 1 nm", 2.7e-16: "< 1 nm", 3e-9: "3 nm", 5e-5: "50.0 µm", 2e-4: "0.2 mm", 1.5702: "1570.2 mm"}
    assert {value: length(value) for value in lengths} == lengths
    degrees = {0.0: "< 0.000001°", 1e-7: "< 0.000001°", 3e-5: "0.000030°", -90.0: "-90.00°", 180.0: "180.00°"}
    assert {value: angle(np.radians(value)) for value in degrees} == degrees
    assert listing([1.5, -0.0, -1e-9, 1000.0, 0.1234567]) == "1.5, 0, 0, 1000, 0.123"


def test_a_pose_reads_back_as_it_is_written(rng):
    for pitch in (None, 90.0, -90.0):
        rpy = rng.uniform(-np.pi, np.pi, 3)
        rpy[1] = np.radians(pitch) if pitch is not None else 0.5 * rpy[1]
        T = mq.pose(rng.uniform(-2, 2, 3), rpy=rpy)
        np.testing.assert_allclose(position_of(position_text(T)), T.translation, atol=1e-6)
        np.testing.assert_allclose(rotation_of_rpy(rpy_text(T)), T.rotation, atol=5e-5)
        np.testing.assert_allclose(rotation_of_quaternion(quaternion_text(T)), T.rotation, atol=5e-6)


def test_numbers_are_taken_with_any_separator_and_refused_with_an_example():
    for text in ("1, 2.5,-3", "1 2.5 -3", "[1; 2.5; -3]", " (1,2.5\t-3) "):
        np.testing.assert_array_equal(numbers(text, 3, "x, y, z"), [1, 2.5, -3])
    for text in ("", "1, 2", "1, 2, 3, 4", "1, 2, x", "1, 2, nan", "1, 2, inf"):
        with pytest.raises(OptionError, match=r"x, y, z: 3 numbers, such as 1, 2, 3"):
            numbers(text, 3, "x, y, z")
    with pytest.raises(OptionError, match="no orientation"):
        rotation_of_quaternion("0, 0, 0, 0")
    np.testing.assert_allclose(rotation_of_quaternion("0 2 0 0"), np.diag([1.0, -1, -1]))


@pytest.mark.parametrize("kind", KINDS)
def test_solids_take_the_sizes_that_they_name(kind):
    shape = solid(kind, 0.2, mq.pose([1, 2, 3]), "thing")
    assert len(sizes_of(shape)) == label_of(shape).count(",") + 1
    typed = listing(10.0 * np.arange(1, 1 + len(sizes_of(shape))))
    changed = resized(shape, typed)
    assert listing(sizes_of(changed)) == typed
    assert (changed.name, type(changed)) == ("thing", type(shape))
    np.testing.assert_array_equal(changed.pose.translation, [1, 2, 3])
    for wrong in ("-1", "0, 0, 0", "1, 2, 3, 4"):
        with pytest.raises(OptionError):
            resized(shape, wrong)


def test_lines_that_are_copied_hold_no_markup_of_files():
    assert "<script" not in copied_lines([("<script>", '"><script>alert(1)</script>')])


def moment(value: float) -> Moment:
    return Moment(np.full(2, value), {"tool": mq.pose([value, 0, 0])})


def test_undo_goes_back_to_where_the_arm_rested_and_redo_forth():
    history = History(moment(0))
    assert history.undo(moment(0)) is None
    for value in (1, 1, 2):
        history.rest(moment(value))
    assert history.undo(moment(2.5)).q[0] == 2  # on its way somewhere
    assert history.undo(moment(2)).q[0] == 1
    assert history.undo(moment(1)).q[0] == 0
    assert history.undo(moment(0)) is None
    assert history.redo().q[0] == 1
    history.rest(moment(1))  # the arm rests where it was brought: what follows is kept
    assert history.redo().q[0] == 2
    assert history.redo() is None
    history.undo(moment(2))
    history.rest(moment(5))  # another way: what was there is forgotten
    assert history.redo() is None
    for value in range(2 * MOST):
        history.rest(moment(10 + value))
    kept, now = 0, moment(9 + 2 * MOST)
    while (now := history.undo(now)) is not None:
        kept += 1
    assert kept == MOST - 1
