"""Kernels with and without Numba's compiler."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numba import config
from support.compiled_problems import arm, compiled, configurations, reachable_rows, search_for

import maira_qp as mq
from maira_qp.kernels.jit.inlining import INLINE
from maira_qp.kernels.qp.box_qp import solve_box_qp
from maira_qp.problem.targets import rows_of
from maira_qp.solvers import ahead
from maira_qp.solvers.ahead import JOBS, VERBS, jobs


def answers() -> np.ndarray:
    """Angles and outcomes (21, 16) of searches on MAIRA: from starts and without, one of them out of reach."""
    problem, rng = compiled(arm("maira"), max_restarts=10), np.random.default_rng(7)
    rows, starts = reachable_rows(problem.robot, rng, 10), configurations(problem.robot, rng, 10)
    rows[9, 9:] *= 5.0
    solver, target = mq.Solver(problem.robot, redundancy=None), problem.robot.forward(starts[0])
    solution = solver.solve(target)
    one = np.r_[solution.q, solution.success, solution.restarts, solution.iterations]
    parts = [search_for(problem, rows), search_for(problem, rows, starts, shuffled=True)]
    searched = np.concatenate([np.hstack(part) for part in parts])
    return np.vstack([searched, np.pad(one, (0, searched.shape[1] - len(one)))])


def run(script: str, cwd: Path, **environment: str) -> str:
    """What a Python of its own prints, started in a folder; a variable that is empty is not set."""
    environment = os.environ | {"PYTHONWARNINGS": "error"} | environment
    environment = {key: value for key, value in environment.items() if value}
    command = [sys.executable, "-c", script]
    ran = subprocess.run(command, cwd=cwd, capture_output=True, text=True, check=False, env=environment)
    assert ran.returncode == 0, ran.stderr
    return ran.stdout


def test_plain_python_gives_the_answers_of_compiled_code(tmp_path):
    """In a process of its own that runs without the compiler."""
    file, here = tmp_path / "answers.npy", Path(__file__).parent
    script = "import numpy, test_compilation as twin; numpy.save('answers.npy', twin.answers())"
    run(
        script,
        tmp_path,
        NUMBA_DISABLE_JIT="1",
        PYTHONPATH=os.pathsep.join(map(str, (here, *here.parents[1:3]))),
    )
    found, expected = np.load(file), answers()
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9)
    assert 0 < expected[:, 7].sum() < len(expected)


def kernel_answers() -> np.ndarray:
    """Numbers of kernels that call others: exact rows of poses, Jacobians, and the solution of a box QP."""
    rng, robot = np.random.default_rng(5), mq.Robot.maira()
    q = configurations(robot, rng, 5)
    rows, _ = rows_of(np.array([robot.forward(each).homogeneous for each in q]))
    root, x = rng.normal(size=(7, 7)), np.empty(7)
    memory = np.empty((7, 7)), np.empty(7, np.int64), np.empty(7, np.int64), np.empty(7)
    assert solve_box_qp(root @ root.T, 9.0 * rng.normal(size=7), np.full(7, -1.0), np.full(7, 0.5), *memory, x)
    assert (x == 0.5).any()
    return np.concatenate([rows.ravel(), robot.jacobians(q).ravel(), x])


@pytest.mark.skipif(config.DISABLE_JIT, reason="nothing is compiled")
def test_without_our_own_passes_the_compiler_gives_the_same_answers(tmp_path):
    """To rounding: how parts are put together may decide what is contracted."""
    here = Path(__file__).parent
    script = "import numpy, test_compilation as twin; numpy.save('answers.npy', twin.kernel_answers())"
    run(
        script,
        tmp_path,
        MAIRA_QP_INLINE="0" if INLINE else "1",
        PYTHONPATH=os.pathsep.join(map(str, (here, *here.parents[1:3]))),
    )
    np.testing.assert_allclose(np.load(tmp_path / "answers.npy"), kernel_answers(), rtol=0, atol=1e-12)


AHEAD = """
import pickle
import numpy as np
import maira_qp as mq
from support.robots import load
from maira_qp.kernels.jit.code_cache import CodeCache
from maira_qp.solvers.ahead import JOBS

for job in JOBS.values():
    job()
find = CodeCache.load_overload
def told(self, sig, context):
    print("not ahead:", self._name, sig)
    return find(self, sig, context)
CodeCache.load_overload = told

for robot in (mq.Robot.maira(), load("panda"), load("pr2_arm"), load("ur5")):
    q = robot.lower.clip(-2) + 0.4 * (robot.upper.clip(max=2) - robot.lower.clip(-2))
    near, far = robot.forward(q), robot.forward(q)
    far.translation += 9.0
    edge = robot.forward(np.zeros(robot.n)) if robot.n == 7 else near
    for redundancy in (None, mq.Strict(mq.Posture()), mq.Weighted(mq.LimitDistance(), weight=1e-3)):
        solver = mq.Solver(robot, redundancy=redundancy, options=mq.Options(max_restarts=3))
        for target in (near, far, edge):
            solver.solve(target)
            solver.solve(target, q0=q, rng=7)
        batch = solver.solve_batch([near, far, edge])
        solver.solve_batch([near, far], q0=q, seed=3, threads=2)
        batch[0].condition_number, batch.condition_number
        solver.step(q, near, 0.01)
        for clutch in (None, mq.Clutch()):
            tracker = pickle.loads(pickle.dumps(mq.Tracker(solver, q, clutch=clutch)))
            for T in (near, tracker.update(near.homogeneous, 0.01).target):
                tracker.update(T, 0.01)
            if clutch:
                tracker.engage()
            tracker.update(near, 0.01)
    solver.solutions(near)
    motion = [robot.forward(q + 0.02 * k) for k in range(8)]
    for path in (motion, [*motion[:4], far, *motion[4:]], [near, edge, near]):
        solver.track(path, max_step=0.1).proof
        solver.track(path, q, dt=0.1)
"""


@pytest.mark.skipif(config.DISABLE_JIT, reason="nothing is compiled")
def test_nothing_is_compiled_that_was_not_compiled_ahead(tmp_path):
    """Of whatever an arm is asked once each job has run."""
    here = Path(__file__).parent
    assert run(AHEAD, tmp_path, PYTHONPATH=os.pathsep.join(map(str, (here, *here.parents[1:3])))) == ""


def test_only_what_an_arm_and_its_solver_need_is_compiled(maira, ur5):
    """The closed form for S-R-S arms, what settles for a redundancy; unknown verbs are refused with the valid ones."""
    assert list(jobs(None, VERBS)) == list(JOBS)
    assert list(jobs(maira, ["step"])) == ["step"]
    assert set(JOBS) - set(jobs(ur5, VERBS)) == {"closed_form", "posture_seed", "nearest_in_closed_form"}
    assert set(JOBS) - set(jobs(mq.Solver(maira), VERBS)) == {"settle", "settle_alone", "trade_off", "posture_seed"}
    assert set(JOBS) - set(jobs(mq.Solver(maira, redundancy=mq.Strict(mq.Posture())), VERBS)) == {"trade_off"}
    with pytest.raises(mq.errors.OptionError, match="did you mean 'solve'"):
        mq.compile(verbs=["slove"])
    with pytest.raises(mq.errors.OptionError, match="processes"):
        mq.compile(processes=0)


@pytest.mark.skipif(config.DISABLE_JIT, reason="nothing is compiled")
def test_jobs_are_run_in_processes_and_counted(monkeypatch, tmp_path):
    """What a job says as it fails is passed on, and without a folder nothing is begun."""
    monkeypatch.setattr(ahead, "jobs", lambda *_: iter(["small", "small"]))
    counts = []
    mq.compile(progress=lambda *count: counts.append(count))
    assert counts == [(0, 2), (1, 2), (2, 2)]
    monkeypatch.setattr(ahead, "jobs", lambda *_: iter(["none of them"]))
    with pytest.raises(mq.errors.CompilationError, match="KeyError: 'none of them'"):
        mq.compile()
    (tmp_path / "file").touch()
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path / "file"))
    with pytest.raises(mq.errors.CompilationError, match="NUMBA_CACHE_DIR"):
        mq.compile()
