"""What is installed here and whether it works: versions, QP backends, extras, the compiled code's cache, and one solve.

Each finding says what was seen and, where something is wrong, what to do about it. What is missing but optional is told
and is no fault.
"""

from __future__ import annotations

import importlib
import importlib.metadata
import importlib.util
import os
import platform
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

import numpy as np

import maira_qp
from maira_qp.errors import BackendError

NEEDED = {
    "numpy": "numpy",
    "scipy": "scipy",
    "numba": "numba",
    "pin": "pinocchio",
    "coal": "coal",
    "qpsolvers": "qpsolvers",
    "daqp": "daqp",
    "tyro": "tyro",
    "rich": "rich",
}
"""Distributions that nothing works without, and their modules."""
EXTRAS = {
    "plot": ("matplotlib", "PIL"),
    "parquet": ("pyarrow",),
    "view": ("viser",),
    "time": ("toppra", "ruckig"),
    "rerun": ("rerun",),
    "closed-form": ("eaik",),
    "qp": ("piqp", "clarabel"),
    "scale": ("dask", "distributed", "zarr", "pyarrow"),
    "ray": ("ray",),
    "surface": ("skimage",),
    "mujoco": ("mujoco",),
    "xacro": ("xacro",),
}
"""Modules that an extra brings."""
POSE = ((0.4, 0.2, 0.9), (0.0, 1.0, 0.0, 0.0))
"""A pose of MAIRA that can be reached: position [m], quaternion."""
REINSTALL = "pip install --force-reinstall maira-qp"
PACKAGES = {"proxqp": "proxsuite"}
"""What pip calls a backend, where that is not its name."""
SOLVED = 1e-6
"""A QP is solved if no entry of x is further off."""
FIRST = {
    "search.multi_start.search": "the first solve compiles for some 10 seconds",
    "refinement.stabilized_sqp_simd.settle_in_lanes": "the first with a redundancy for some 10 more",
}
"""What is to be expected where a kernel has not been compiled yet."""
AT_POSE = 2e-6
"""How far the plain DH chain may be from the pose [m, rad]: the tolerance, and what two ways of computing differ by."""


class State(Enum):
    """How a finding is to be taken."""

    WELL = "ok"
    ABSENT = "absent"
    """Optional: no fault"""
    FAULT = "fault"


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at."""

    group: str
    name: str
    state: State
    told: str
    """What was seen"""
    advice: str = ""
    """What to do about it"""


def examine() -> Iterator[Finding]:
    """Look at everything, one after the other; nothing that is missing or broken stops it."""
    for look in (versions, backends, extras, processors, cache, self_check):
        try:
            yield from look()
        except Exception as reason:  # whatever is broken is what is looked for
            told = f"{type(reason).__name__}: {reason}"
            yield Finding(look.__name__, "all of it", State.FAULT, told, REINSTALL)


def versions() -> Iterator[Finding]:
    """This package, Python and what both need."""
    yield Finding("versions", "maira_qp", State.WELL, maira_qp.__version__)
    yield Finding("versions", "python", State.WELL, f"{platform.python_version()}, {sys.platform} {platform.machine()}")
    for name, module in NEEDED.items():
        if importlib.util.find_spec(module) is None:
            yield Finding("versions", name, State.FAULT, "not installed", REINSTALL)
        else:
            yield Finding("versions", name, State.WELL, _version(name, module))


def _version(name: str, module: str) -> str:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:  # from elsewhere than pip
        return getattr(importlib.import_module(module), "__version__", "of unknown version")


def backends() -> Iterator[Finding]:
    """Each QP backend solves `min 1/2 |x|^2 + x_1 + x_2` with `x >= -1/2`: x = -1/2."""
    from maira_qp.problem.qp.backends import ACCURATE, Backend, available
    from maira_qp.problem.qp.qp import QP

    installed = available()
    for name in dict.fromkeys([*ACCURATE, *installed]):
        package = PACKAGES.get(name, name)
        if name not in installed:
            yield Finding("backends", name, State.ABSENT, "", f"pip install {package}")
            continue
        failed = State.FAULT if name in ACCURATE else State.ABSENT  # the others may need settings of their own
        qp = QP(np.eye(2), np.ones(2), np.full(2, -0.5), np.ones(2), np.empty((0, 2)), np.empty(0))
        try:
            error = float(np.abs(Backend(name).solve(qp).x + 0.5).max())
        except BackendError as reason:
            yield Finding("backends", name, failed, str(reason), f"pip install --upgrade {package}")
            continue
        told = f"a small QP solved, error {error:.0e}"
        if error < SOLVED:
            yield Finding("backends", name, State.WELL, told)
        else:
            yield Finding("backends", name, failed, told, f"pip install --upgrade {package}")


def extras() -> Iterator[Finding]:
    """What pip installs on demand."""
    for extra, modules in EXTRAS.items():
        missing = [module for module in modules if importlib.util.find_spec(module) is None]
        if missing:
            told = f"without {', '.join(missing)}"
            yield Finding("extras", extra, State.ABSENT, told, f"pip install 'maira-qp[{extra}]'")
        else:
            yield Finding("extras", extra, State.WELL, ", ".join(modules))


def processors() -> Iterator[Finding]:
    """How many this process may use."""
    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    yield Finding("engine", "processors", State.WELL, f"{usable} of {os.cpu_count()}")


def cache() -> Iterator[Finding]:
    """Where the compiled code is kept, and whether some of it has yet to be compiled."""
    from numba import config

    from maira_qp.kernels.jit import code_cache

    if config.DISABLE_JIT:
        told = "switched off: a solve takes a thousand times as long"
        yield Finding("engine", "compiled code", State.FAULT, told, "unset NUMBA_DISABLE_JIT")
        return
    folder = code_cache.writable()
    if folder is None:
        tried = ", ".join(map(str, code_cache.roots())) or "no folder: the sources of the kernels are not installed"
        told = f"kept nowhere, each process compiles anew; tried {tried}"
        yield Finding("engine", "compiled code", State.FAULT, told, "set NUMBA_CACHE_DIR to a folder to write to")
        return
    kept = code_cache.kept()
    current = [file for file in kept if file.parent == folder]
    told = f"{len(current)} files, {_megabytes(current)}, in {folder} (writable)"
    if len(kept) > len(current):
        told += f"; {_megabytes(kept)} with what is older or of other environments: maira-qp cache --clear"
    for kernel, work in FIRST.items():
        if not any(file.name.startswith(f"{kernel}-") for file in current):
            told += f"; {work}"
    yield Finding("engine", "compiled code", State.WELL, told)


def _megabytes(files: list[Path]) -> str:
    return f"{sum(file.stat().st_size for file in files) / 1e6:.0f} MB"


def self_check() -> Iterator[Finding]:
    """MAIRA solves a pose, judged by the plain DH chain, which shares no code with the solver."""
    from maira_qp.evaluation.judge import angle_between
    from maira_qp.problem.pose import pose
    from maira_qp.robots.model.catalog import maira
    from maira_qp.robots.model.robot import Robot
    from maira_qp.solvers.solver import Solver

    robot, target = Robot.maira(), pose(POSE[0], quaternion=POSE[1]).homogeneous
    s = Solver(robot).solve(target)
    reached = maira().compute_htms(s.q)[-1]
    position = float(np.linalg.norm(reached[:3, 3] - target[:3, 3]))
    orientation = angle_between(reached[:3, :3], target[:3, :3])
    inside = bool(((robot.lower <= s.q) & (s.q <= robot.upper)).all())
    told = f"one pose for MAIRA, {s.backend}: {s.status.name}, position error {position:.0e} m, "
    told += f"orientation error {orientation:.0e} rad, {'inside' if inside else 'OUTSIDE'} the joint limits"
    if s.success and inside and max(position, orientation) <= AT_POSE:
        yield Finding("engine", "self-check", State.WELL, told)
    else:
        yield Finding("engine", "self-check", State.FAULT, told, REINSTALL)
