"""Kernels with and without Numba's compiler."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
from compiled_problems import arm, compiled, configurations, reachable_rows, search_for

import maira_qp as mq


def answers() -> np.ndarray:
    """Angles and outcomes (21, 14) of searches on MAIRA: from starts and without, one of them out of reach."""
    problem, rng = compiled(arm("maira"), max_restarts=10), np.random.default_rng(7)
    rows, starts = reachable_rows(problem.robot, rng, 10), configurations(problem.robot, rng, 10)
    rows[9, 9:] *= 5.0
    solver, target = mq.Solver(problem.robot, redundancy=None), problem.robot.forward(starts[0])
    solution = solver.solve(target)
    one = np.r_[solution.q, solution.success, solution.restarts, solution.iterations, 0, 0, 0, 0]
    parts = [search_for(problem, rows), search_for(problem, rows, starts, shuffled=True)]
    return np.vstack([np.concatenate([np.hstack(part) for part in parts]), one])


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
        PYTHONPATH=os.pathsep.join(map(str, (here, here.parent))),
    )
    found, expected = np.load(file), answers()
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9)
    assert 0 < expected[:, 7].sum() < len(expected)
