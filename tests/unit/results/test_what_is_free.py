"""Errors of what the tasks leave free are said to be free, in words and in files, and are no number there."""

import csv
import io
import pickle

import numpy as np
import pytest

import maira_qp as mq
from maira_qp.apps.cli import main
from maira_qp.io.answers import columns

FREE = {
    "position": (mq.PositionTask(), ("orientation",)),
    "orientation": (mq.OrientationTask(), ("position",)),
    "pose": (mq.PoseTask(), ()),
    "pose of a free orientation": (mq.PoseTask(orientation_weight=0), ("orientation",)),
    "axis": (mq.AxisTask(), ("position",)),
}


@pytest.mark.parametrize("name", FREE)
def test_results_say_what_is_free(maira, name):
    task, free = FREE[name]
    solver, target = mq.Solver(maira, task=task), maira.forward(maira.middle + 0.3)
    s, tick = solver.solve(target), solver.step(maira.middle, target, 0.01)
    batch = solver.solve_batch([target, target])
    for one in (s, batch, batch[0], tick, pickle.loads(pickle.dumps(s)), pickle.loads(pickle.dumps(tick))):
        assert one.left_free == free
        for part in ("position", "orientation"):
            free_words = f"{part} free", f"{part} error [rad]: free", f"{part} error [m]: free"
            assert any(words in repr(one) for words in free_words) == (part in free)
    for part in ("position", "orientation"):
        unknown = part in free
        assert (s.as_dict()[f"{part}_error"] is None) == unknown
        assert np.isnan(columns(batch)[f"{part}_error"]).all() == unknown
        assert not unknown or getattr(s, f"{part}_error") == 0.0
    if free == ("orientation",):
        assert s.success == (np.linalg.norm(maira.forward(s.q).translation - target.translation) <= 1e-6)


def test_what_one_of_several_tasks_measures_is_not_free(maira):
    tasks = [mq.PositionTask(), mq.AxisTask(frame="link4", direction=[0, 0, 1])]
    assert mq.Solver(maira, task=tasks).problem.left_free == ()


def test_commands_and_listed_solutions_say_it():
    robot = mq.Robot.from_dh([mq.DHLink(a=1.0, lower=-3, upper=3), mq.DHLink(a=0.8, lower=-2.5, upper=2.5)])
    solver, q = mq.Solver(robot, task=mq.PositionTask(position_weight=[1, 1, 0])), np.array([0.3, 0.8])
    assert "orientation free" in repr(mq.Tracker(solver, q).update(robot.forward(q), 0.01))
    listed = solver.solutions(robot.forward(q))
    assert len(listed) == 2
    assert all("orientation free" in repr(one) for one in listed)


def test_a_file_of_positions_is_answered_with_empty_cells(tmp_path, capsys):
    source, output = tmp_path / "points.csv", tmp_path / "answers.csv"
    source.write_text("x,y,z\n0.4,0.2,0.9\n0.3,0.1,0.8\n")
    assert main(["solve", "--batch", str(source), "--output", str(output)]) == 0
    assert "worst orientation error [rad] │ free" in " ".join(capsys.readouterr().out.split())
    rows = list(csv.DictReader(io.StringIO(output.read_text())))
    assert [row["orientation_error"] for row in rows] == ["", ""]
    assert all(float(row["position_error"]) <= 1e-6 for row in rows)


def test_the_names_of_statuses(maira):
    batch = mq.Solver(maira).solve_batch([maira.forward(maira.middle), mq.pose([9.0, 0, 0])])
    assert batch.status_names.tolist() == ["CONVERGED", "UNREACHABLE"] == [one.status.name for one in batch]
    assert (batch.status_names == "CONVERGED").sum() == batch.success.sum()
    assert batch[:0].status_names.shape == (0,)
