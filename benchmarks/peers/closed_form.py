"""Peers that solve in closed form: EAIK, with samples of the redundant joint, and ssik, with code made for the arm."""

from __future__ import annotations

import io
from collections.abc import Sequence
from contextlib import redirect_stderr, redirect_stdout
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType

import numpy as np

from maira_qp.evaluation.contestant import Contestant
from peers.arms import Arm

SAMPLES = 64
"""Values of the redundant joint; a power of 2, for they are tried in bit-reversed order, the coarse ones first."""


def eaik(arm: Arm) -> Contestant:
    """Subproblem decomposition in C++, an arm of six joints for each sample of the seventh."""
    from eaik.pybindings.EAIK import Robot

    axes, points, home = arm.screws()
    offsets = np.vstack([points[:1], np.diff(points, axis=0), home[:3, 3] - points[-1]])
    values, locks = np.zeros(1), [[]]
    if arm.sampled is not None:
        values = np.linspace(arm.lower[arm.sampled], arm.upper[arm.sampled], 2 * SAMPLES + 1)[1::2][_bit_reversed()]
        locks = [[(arm.sampled, value)] for value in values]
    robots = [Robot(axes.T, offsets.T, home[:3, :3], lock, True) for lock in locks]
    if not robots[0].has_known_decomposition():
        raise ValueError("it knows no decomposition of this arm")
    middle = (arm.lower + arm.upper) / 2

    def solve(target: np.ndarray, start: np.ndarray | None) -> np.ndarray | None:
        order = range(len(robots))
        if start is not None and arm.sampled is not None:
            order = np.argsort(np.abs(values - start[arm.sampled]))
        for k in order:
            answer = robots[k].calculate_IK(target)
            if answer.num_solutions():
                q = answer.Q - 2 * np.pi * np.round((answer.Q - middle) / (2 * np.pi))
                inside = ((q >= arm.lower) & (q <= arm.upper)).all(axis=1) & ~np.asarray(answer.is_LS, dtype=bool)
                if inside.any():
                    q = q[inside]
                    return q[0] if start is None else q[np.abs(q - start).max(axis=1).argmin()]
        return None

    def forward(q: np.ndarray) -> np.ndarray:
        lock = [] if arm.sampled is None else [(arm.sampled, q[arm.sampled])]
        return Robot(axes.T, offsets.T, home[:3, :3], lock, True).fwdkin(q)

    settings = "limits checked"
    if arm.sampled is not None:
        settings = f"{SAMPLES} samples of joint {arm.sampled + 1}, {settings}"
    return Contestant(name="EAIK", settings=settings, forward=forward, solve=solve, draws_starts=True)


def _bit_reversed() -> Sequence[int]:
    bits = SAMPLES.bit_length() - 1
    return [int(f"{k:0{bits}b}"[::-1], 2) for k in range(SAMPLES)]


def ssik(arm: Arm) -> Contestant:
    """Closed form with exact intervals of the redundancy, by the module that `ssik build` writes for the arm."""
    module = _build(arm)

    def solve(target: np.ndarray, start: np.ndarray | None) -> np.ndarray | None:
        answers = module.solve(target, max_solutions=1, q_seed=start)
        return answers[0].q if answers else None

    return Contestant(
        name="ssik", settings="first solution, ssik build", forward=module.fk, solve=solve, draws_starts=True
    )


def _build(arm: Arm) -> ModuleType:
    from ssik.cli import main

    path = Path(arm.path).with_name(f"{arm.name}_ik.py")
    said = io.StringIO()
    with redirect_stdout(said), redirect_stderr(said):
        ends = ["--base", arm.robot.base, "--ee", arm.robot.tip]
        status = main(["build", str(arm.path), *ends, "--out", str(path), "--no-validate"])
    spec = spec_from_file_location(path.stem, path)
    if status or spec is None or spec.loader is None:
        raise RuntimeError(f"ssik build failed: {said.getvalue()}")
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
