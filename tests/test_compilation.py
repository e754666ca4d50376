"""Kernels with and without Numba's compiler, and with and without a folder to keep them in."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
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


@pytest.fixture
def package(tmp_path) -> Path:
    """A copy of the package in which nothing can be written beside the code."""
    copy = tmp_path / "site" / "maira_qp"
    shutil.copytree(Path(mq.__file__).parent, copy, ignore=shutil.ignore_patterns("__pycache__"))
    for folder in [copy, *filter(Path.is_dir, copy.rglob("*"))]:
        (folder / "__pycache__").write_text("a file where a folder is needed: not even root can write into it")
    return copy


USE = """
import numpy as np
import maira_qp
from maira_qp.kernels.random_numbers import stream_of
print(maira_qp.__file__)
print(stream_of(np.arange(12.0), np.array([1, 2], dtype=np.uint64)))
"""


def stream_in(package: Path, home: Path) -> str:
    """What the copy answers, with its home there."""
    environment = {"HOME": str(home), "XDG_CACHE_HOME": "", "NUMBA_CACHE_DIR": "", "NUMBA_DISABLE_JIT": ""}
    file, stream = run(USE, package.parent, PYTHONPATH=str(package.parent), **environment).split()
    assert Path(file).parent == package
    return stream


def test_kernels_are_kept_in_the_home_where_the_package_takes_nothing(package, tmp_path):
    """And found there by the next process."""
    home = tmp_path / "home"
    home.mkdir()
    first = stream_in(package, home)
    kept = {file: file.stat().st_mtime_ns for file in home.rglob("*.nbc")}
    assert kept
    assert stream_in(package, home) == first
    assert {file: file.stat().st_mtime_ns for file in home.rglob("*.nbc")} == kept


def test_kernels_compile_where_there_is_no_folder_for_the_cache(package, tmp_path):
    """Neither the package nor a home: slower to start, but no failure, and nothing is left anywhere."""
    nowhere = tmp_path / "nowhere"
    nowhere.write_text("")
    stream_in(package, nowhere)
    assert not list(tmp_path.rglob("*.nb[ci]"))
