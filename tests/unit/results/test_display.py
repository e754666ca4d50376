"""What objects show of themselves, in a terminal and in a notebook, and pass on as JSON."""

import json
import pickle
from enum import IntEnum
from xml.etree import ElementTree

import numpy as np
import pytest
from support.robots import load

import maira_qp as mq
from maira_qp.display import Card, shortened
from maira_qp.errors import MairaError, OptionError, PoseError

MOST_LINES = 18


@pytest.fixture(scope="module")
def batch(maira) -> mq.BatchSolution:
    targets = [maira.forward(maira.middle + 0.3), mq.pose([5.0, 0, 0]), maira.forward(maira.middle - 0.4)]
    return mq.Solver(maira, redundancy=mq.Strict(mq.Posture())).solve_batch(targets)


def shown(maira: mq.Robot, batch: mq.BatchSolution) -> dict[str, object]:
    solver = mq.Solver(maira, limits=[mq.LinearLimit(np.ones((1, 7)), [50.0])], redundancy=mq.Strict(mq.Posture()))
    target = maira.forward(maira.middle + 0.3)
    solutions = mq.Solver(maira).solutions(target)
    return {
        "robot": maira,
        "solver": solver,
        "solution": batch[0],
        "batch": batch,
        "pickled": pickle.loads(pickle.dumps(batch[1])),
        "step": mq.Solver(maira).step(maira.middle, target, 0.01),
        "solutions": solutions,
        "listed": solutions[0],
        "arc": solutions[0].arc,
        "explanation": batch[1].explain(),
    }


def check(one: object) -> None:
    """It fits a terminal, and its HTML is a tree."""
    lines = repr(one).splitlines()
    assert max(map(len, lines)) <= 80
    assert len(lines) <= MOST_LINES
    ElementTree.fromstring(f"<div>{one._repr_html_()}</div>")


def test_what_is_shown_fits_a_terminal_and_names_the_joints(maira, batch):
    for name, one in shown(maira, batch).items():
        check(one)
        if name != "explanation":
            for joint in maira.joint_names:
                assert joint in repr(one), name
                assert joint in one._repr_html_(), name
    assert "UNREACHABLE" in repr(batch[1])
    assert "proved to be out of reach" in repr(batch[1].explain())


def test_a_robot_of_many_joints_with_long_names_fits_too():
    talos_whole = load("talos_whole")
    check(talos_whole)
    check(mq.Solver(talos_whole))
    step = mq.Solver(talos_whole).step(
        talos_whole.middle, {tip: talos_whole.forward(talos_whole.middle, tip) for tip in talos_whole.tips}, 0.01
    )
    check(step)
    assert "more" in repr(step)


def test_names_are_escaped_in_html_and_lose_their_middle_in_text():
    card = Card(title="<b>", facts=(("<i>", "&"),), entries=["a" * 200], headings=("<",), rows=[("<script>",)] * 50)
    assert "<script>" not in card.html
    assert "and 20 more" in card.html
    ElementTree.fromstring(f"<div>{card.html}</div>")
    assert shortened("abcdefghij", 5) == "ab…ij"
    assert max(map(len, card.text.splitlines())) <= 80


def test_of_a_long_batch_a_notebook_has_some_rows_and_says_how_many_more_there_are(batch):
    many = batch[[0] * 1500]
    assert many._repr_html_().count("CONVERGED</td>") == 10
    assert "and 1,490 more" in many._repr_html_()
    assert "more" not in batch._repr_html_()


def test_a_status_prints_its_name_and_counts_as_its_number(batch):
    enums = [value for value in vars(mq).values() if isinstance(value, type) and issubclass(value, IntEnum)]
    assert mq.Status in enums
    for member in (member for enum in enums for member in enum):
        assert str(member) == f"{member}" == member.name
    assert f"{mq.Status.NEAREST:>9}|{mq.Status.NEAREST:d}" == "  NEAREST|2"
    assert [str(one.status) for one in batch] == ["CONVERGED", "UNREACHABLE", "CONVERGED"]
    assert mq.Status.UNREACHABLE == 1
    assert batch.status.dtype.kind == "i"


def test_a_solution_is_true_if_it_succeeded_and_a_batch_is_neither(batch):
    assert batch[0]
    assert not batch[1]
    with pytest.raises(MairaError, match=r"batch\.success\.all\(\)"):
        bool(batch)


def test_a_batch_is_indexed_as_an_array(batch):
    np.testing.assert_array_equal(batch[np.int64(1)].q, batch.q[1])
    np.testing.assert_array_equal(batch[-1].q, batch.q[2])
    for index in (batch.success, [0, 2], [True, False, True], np.array([-3, -1]), slice(0, None, 2)):
        part = batch[index]
        np.testing.assert_array_equal(part.q, batch.q[[0, 2]])
        np.testing.assert_array_equal(part.status, batch.status[[0, 2]])
        np.testing.assert_array_equal(part[1].jacobian(), batch[2].jacobian())
        assert len(part.active_limits) == 2
    assert len(batch[[]]) == len(batch[np.zeros(3, dtype=bool)]) == 0
    part = batch[[0]]
    part.q[0, 0] = 9.0
    assert batch.q[0, 0] != 9.0


@pytest.mark.parametrize(
    ("index", "words"),
    [
        (3, "no target 3 in a batch of 3"),
        (-4, "no target -4"),
        ([0, 7], "no target 7"),
        ([True, False], "has 3 entries, not 2"),
        (1.0, "not by 1.0"),
        ("q", "not by 'q'"),
        (None, "not by None"),
        (True, "not by True"),
        ((0, 1), "not by"),
        ([[0], [1, 2]], "not by"),
        (np.zeros((3, 2), dtype=bool), "not by"),
    ],
)
def test_a_wrong_index_of_a_batch_is_told(batch, index, words):
    with pytest.raises(IndexError, match=words):
        batch[index]


def test_values_go_through_json(maira, batch):
    """Numbers that are not known are null; statuses are their names; pickled answers know the same."""
    one = mq.Solver(maira).solve(maira.forward(maira.middle + 0.2))  # without redundancy: no cost
    read = json.loads(json.dumps(one.as_dict(), allow_nan=False))
    assert read["cost"] is None
    assert read["status"] == "CONVERGED"
    assert read["joint_names"] == list(maira.joint_names)
    np.testing.assert_array_equal(read["q"], one.q)
    many = json.loads(json.dumps(batch.as_dict(), allow_nan=False))
    np.testing.assert_array_equal(many["q"], batch.q)
    assert many["active_limits"] == batch.active_limits
    assert json.loads(json.dumps(batch[1].explain().as_dict(), allow_nan=False))["status"] == "UNREACHABLE"
    assert pickle.loads(pickle.dumps(batch)).as_dict() == batch.as_dict()
    public = {name for name in vars(one) if not name.startswith("_")}
    assert public <= set(one.as_dict())


def test_angles_in_degrees_are_hinted_at_where_they_come_in(maira, caplog):
    """Nothing is converted: the pose is that of the radians."""
    T = mq.pose([0.4, 0, 0.5], rpy=[0, 90, 0])
    assert "rpy holds 90 rad; is it in degrees?" in caplog.text
    np.testing.assert_allclose(T.rotation[0, 0], np.cos(90.0))
    caplog.clear()
    mq.pose([0.4, 0, 0.5], rpy=[0, np.pi, -6.2])
    mq.Robot.iiwa14()
    assert caplog.text == ""
    mq.Robot.from_dh([mq.DHLink(kind="revolute", a=0.1, alpha=-90, lower=-3, upper=3)])
    assert "the DH table holds 90 rad; is it in degrees?" in caplog.text
    with pytest.raises(OptionError, match="is it in degrees"):
        maira.limited(upper={"joint2": 90})


@pytest.mark.parametrize("target", [[0.4, 0.2, 0.5], ([0.4, 0.2, 0.5], [0, 1, 0, 0]), np.zeros(7)])
def test_what_is_no_pose_is_told_how_to_make_one(maira, target):
    with pytest.raises(PoseError, match=r"mq\.pose\(\[x, y, z\], quaternion="):
        mq.Solver(maira).solve(target)


def test_a_target_in_millimetres_and_a_start_in_degrees_are_hinted_at(maira):
    solver, target = mq.Solver(maira), maira.forward(maira.middle + 0.3)
    far = target.copy()
    far.translation = 1e3 * target.translation
    s = solver.solve(far)
    assert "is it in millimetres?" in str(s.explain())
    assert "millimetres" in repr(s)
    assert "millimetres" in repr(solver.solve_batch([target, far]))
    for q0 in ([0, 90, 0, 20, 0, 30, 0], [170.0] * 6 + [90]):
        s = solver.solve(target, q0=q0)
        assert s.start_projected
        assert "is it in degrees?" in str(s.explain()) or np.abs(np.radians(q0)[1]) > maira.upper[1]
    for given in (
        solver.solve(target, q0=[0, 4.0, 0, 2, 0, 0, 0]),
        solver.solve(target),
        solver.solve(mq.pose([4, 0, 0])),
    ):
        assert given.hints == ()


def test_limits_that_cost_nothing_are_named_in_one_sentence(maira):
    """A start far beyond two limits is moved onto them; the answer stays on those that the pose leaves free."""
    q = maira.middle + 0.3
    q[[2, 4]] = maira.upper[[2, 4]]
    s = mq.Solver(maira).solve(maira.forward(q), q0=q)
    assert str(s.explain()) == "The target is reached. It stands on joint3 upper and joint5 upper."
