"""Which engine runs when: what is said beforehand is what happens, and what the documentation's tables say."""

from pathlib import Path

import numpy as np
import pytest
from support.robots import load

import maira_qp as mq
from maira_qp.errors import BackendError, OptionError
from maira_qp.solvers.dispatch import tables

POSTURE = mq.Strict(mq.Posture())
CASES = {
    "the pose alone": ({}, "compiled", "compiled"),
    "a posture": ({"redundancy": POSTURE}, "compiled", "compiled"),
    "another objective": ({"redundancy": mq.Strict(mq.Manipulability())}, "compiled", "daqp"),
    "tasks below": ({"tasks": [mq.PositionTask(frame="link4", priority=2)]}, "compiled", "compiled"),
    "two tasks": ({"task": [mq.PositionTask(), mq.OrientationTask()]}, "daqp", "compiled"),
    "a limit": ({"limits": [mq.LinearLimit(np.eye(7)[:1], np.array([3.0]))]}, "daqp", "compiled"),
    "a soft limit": (
        {"tasks": [mq.LimitTask(limit=mq.LinearLimit(np.eye(7)[:1], np.ones(1)), priority=2)]},
        "compiled",
        "daqp",
    ),
    "a backend": ({"backend": "proxqp"}, "proxqp", "proxqp"),
    "a deadline": ({"options": mq.Options(deadline=5.0)}, "compiled", "compiled"),
}


@pytest.mark.parametrize("label", CASES)
def test_the_engine_is_the_one_that_was_said(maira, label):
    arguments, solves, steps = CASES[label]
    solver, q = mq.Solver(maira, **arguments), maira.middle + 0.3
    assert solver.engine_for("solve").engine == solver.engine_for("solve_batch").engine == solves
    assert solver.engine_for("step").engine == steps
    assert solver.engine_for("solve").reason
    frames = solver.problem.target_keys
    target = {frame: maira.forward(q, frame) for frame in frames}
    assert solver.solve(target, maira.middle + 0.1).backend == solves
    assert solver.step(maira.middle, target, 0.01).backend == steps


def test_what_a_call_asks_for_may_need_the_other_engine(maira):
    solver, q = mq.Solver(maira), maira.middle
    assert solver.engine_for(observe=True).engine == "daqp"
    assert "observed" in str(solver.engine_for(observe=True))
    for flag, argument in (("deadline", 1.0), ("keep_direction", True)):
        assert solver.engine_for("step", **{flag: True}).engine == "daqp"
        assert solver.step(q, maira.forward(q + 0.1), 0.01, **{flag: argument}).backend == "daqp"


def test_why_the_compiled_engine_cannot_take_a_problem_is_said(maira):
    with pytest.raises(BackendError, match="it has more than one task"):
        mq.Solver(maira, task=[mq.PositionTask(), mq.OrientationTask()], backend="compiled")
    with pytest.raises(OptionError, match="solve, solve_batch, step"):
        mq.Solver(maira).engine_for("dance")


def test_the_documentation_prints_the_tables_of_the_dispatch():
    root = Path(__file__).parents[3]
    assert "<!-- engines -->" in (root / "docs" / "reference" / "engines.md").read_text(encoding="utf-8")
    rows = [row for row in tables().splitlines() if row.startswith("|")]
    assert len(rows) > 8
    pages = [root / "README.md", *(root / "docs").rglob("*.md")]
    copies = [
        page.name for page in pages if any(row in page.read_text(encoding="utf-8") for row in rows if "---" not in row)
    ]
    assert copies == []


def test_the_engine_that_follows_paths_is_said_or_why_there_is_none(maira):
    """A free axis is no way round the backend that was asked for."""
    free = mq.PoseTask(orientation_weight=[1, 1, 0], axes="target")
    assert str(mq.Solver(maira).engine_for("track")) == "compiled: one task of the tip of a chain"
    assert "free to turn" in mq.Solver(maira, task=free).engine_for("track").reason
    for task in (None, free):
        solver = mq.Solver(maira, task=task, backend="daqp")
        for call in (lambda s: s.engine_for("track"), lambda s: s.track([maira.forward(maira.middle)])):
            with pytest.raises(
                OptionError, match="compiled engine, which cannot take this: a QP backend was asked for"
            ):
                call(solver)


def test_ticks_within_further_limits_are_said_to_be_made_by_either_engine(maira):
    limit = mq.LinearLimit(np.eye(7)[1:2], [maira.middle[1] + 1e-4])
    solver, target = mq.Solver(maira, limits=[limit]), maira.forward(maira.middle + 0.3)
    assert "ticks in which a limit beside those of the joints binds are made by daqp" in str(solver.engine_for("step"))
    assert solver.step(maira.middle - 0.5, target, 0.01).backend == "compiled"
    assert solver.step(maira.middle, target, 0.01).backend == "daqp"


def test_a_seed_is_the_same_by_either_name(maira):
    target, solver = maira.forward(maira.middle + 0.7), mq.Solver(maira, options=mq.Options(position_tolerance=1e-9))
    assert (solver.solve(target, seed=5).q == solver.solve(target, rng=5).q).all()
    assert (solver.solve_batch([target], seed=5)[0].q == solver.solve(target, seed=5).q).all()
    irb = load("irb140")
    pose = irb.forward(irb.middle + 0.3)
    assert len(mq.Solver(irb).solutions(pose, seed=3)) == len(mq.Solver(irb).solutions(pose, rng=3))
    for call in (solver.solve, solver.solutions):
        with pytest.raises(OptionError, match="leave one out"):
            call(target, rng=1, seed=1)
        with pytest.raises(OptionError, match="non-negative"):
            call(target, seed=-1)


def test_a_factor_changes_nothing_for_what_is_alone_at_its_level(maira, rng):
    """As the docstring says; 0 switches it off."""
    solver = mq.Solver(maira, redundancy=mq.Strict(mq.Posture(maira.middle + 0.2)))
    target = maira.forward(maira.random_configuration(rng))
    q = solver.solve(target).q
    for factor in (1e-3, 7.0):
        assert (solver.solve(target, weights={"posture": factor}).q == q).all()
    assert (solver.solve(target, weights={"posture": 0}).q == mq.Solver(maira).solve(target).q).all()
