"""Limits of one kind without names are told apart by number, in whatever speaks of them."""

import numpy as np
import pytest

import maira_qp as mq

TWO = np.eye(7)[[1, 3]]


def standing(maira: mq.Robot, names: tuple[str | None, str | None]) -> mq.Solution:
    """An answer that stands on two limits on joints 2 and 4, which its posture would have elsewhere."""
    limits = [mq.HalfSpaceLimit(frame=f"link{k + 1}", normal=[0, 0, -1], point=[0, 0, 9], name=None) for k in (0, 1)]
    limits = [_Joint(row, 0.2 + 0.3 * k, names[k]) for k, row in enumerate(TWO)]
    wish = mq.Strict(mq.Posture(maira.middle + 0.8))
    return mq.Solver(maira, task=mq.PositionTask(frame="link1"), limits=limits, redundancy=wish).solve(
        maira.forward(maira.middle, "link1")
    )


class _Joint(mq.LinearLimit):
    """A linear limit with a name, if any."""

    def __init__(self, row: np.ndarray, most: float, name: str | None) -> None:
        super().__init__(row[None], [most])
        object.__setattr__(self, "name", name)

    def of(self, robot: mq.Robot) -> "_Joint":
        return self


@pytest.mark.parametrize(
    ("names", "told"),
    [((None, None), ["_Joint 1", "_Joint 2"]), (("a", None), ["a", "_Joint"]), (("a", "b"), ["a", "b"])],
)
def test_explanations_and_active_limits_tell_them_apart(maira, names, told):
    s = standing(maira, names)
    assert s.success
    assert [name for name in s.active_limits if "joint" not in name] == told
    why = s.explain()
    assert sorted(row.name for row in why.rows) == sorted(told)
    by_name = {row.name: row.multiplier for row in why.rows}
    # at the optimum of 1/2 |q - ref|^2 each limit holds its own joint: the multiplier is how far the joint would go
    assert by_name[told[0]] == pytest.approx(0.6, abs=1e-4)
    assert by_name[told[1]] == pytest.approx(0.3, abs=1e-4)
    assert all(name in str(why) for name in told)


def test_broken_limits_have_the_same_names(maira):
    above, below = (mq.HalfSpaceLimit(normal=[0, 0, sign], point=[0, 0, sign * 3.0]) for sign in (1, -1))
    s = mq.Solver(maira, limits=[above, below], options=mq.Options(max_restarts=1)).solve(mq.pose([0.4, 0.2, 0.9]))
    assert s.status is mq.Status.LIMITS_BROKEN
    assert set(s.broken_limits) <= {"HalfSpaceLimit 1", "HalfSpaceLimit 2"}
    assert len(s.broken_limits) == 2


def test_rows_keep_their_numbers(maira):
    limits = [mq.LinearLimit(TWO, [0.0, 0.0]), mq.LinearLimit(np.eye(7)[:1], [0.0])]
    problem = mq.Solver(maira, limits=limits).problem
    assert problem.active_limits(np.zeros(7)) == ["LinearLimit 1 row 1", "LinearLimit 1 row 2", "LinearLimit 2"]
