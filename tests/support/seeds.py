"""What the tests of initial guesses share: the kernels that draw them, and their slow twins."""

import numpy as np

from maira_qp.kernels.jit.simd import LANES
from maira_qp.kernels.layout import Feature
from maira_qp.kernels.search.seeds import fill_library, find_nearest, random_start
from maira_qp.solvers.compiled.engine import Compiled
from support.compiled_problems import descents, row_of

WORD = 2**64


def splitmix(state: int) -> tuple[int, int]:
    """The slow twin of `next_random`, in whole numbers of Python."""
    state = (state + 0x9E3779B97F4A7C15) % WORD
    z = (state ^ (state >> 30)) * 0xBF58476D1CE4E5B9 % WORD
    z = (z ^ (z >> 27)) * 0x94D049BB133111EB % WORD
    return z ^ (z >> 31), state


def poses_of(problem: Compiled, q: np.ndarray) -> np.ndarray:
    """The tool's poses (K, 12) at configurations (K, n)."""
    return np.array([row_of(problem.robot.forward(each)) for each in q])


def features_of(problem: Compiled, poses: np.ndarray) -> np.ndarray:
    """`fill_library` for poses (K, 12)."""
    features = np.full((len(poses) // LANES, Feature.WIDTH, LANES), np.nan)
    fill_library(problem.settings, poses, features)
    return features


def nearest_of(problem: Compiled, features: np.ndarray, row: np.ndarray) -> np.ndarray:
    nearest = np.full(LANES, -7)
    find_nearest(problem.settings, features, row, np.full((2, LANES), np.nan), nearest)
    return nearest


def start_of(problem: Compiled, row: np.ndarray, candidates: int, at_corner: bool, state: int) -> np.ndarray:
    q = np.full(problem.robot.n, np.nan)
    random_start(
        problem.chain, problem.settings, row, candidates, at_corner, np.uint64(state), descents(problem.robot.n), q
    )
    return q
