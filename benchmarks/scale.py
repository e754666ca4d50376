"""What an engine costs beside the bare kernel, and what a map of the reach takes per pose, in one run.

    python benchmarks/scale.py [MILLIONS]
    python benchmarks/scale.py maps

Each line is the work on the same poses of MAIRA: by the bare kernel (the closed form alone), by the job's own function
(with the figures of each cell), and by whole runs of the job, with shards, their checksums, and the output. Processor
time counts the workers too, so that other work on the machine matters less. Two workers are compared with two processes
that do half of the job's function each and nothing else, by the wall clock, in turns. `maps`: 15 million poses of MAIRA
and of a Panda, 5 cm and 200 directions, by one process.
"""

from __future__ import annotations

import multiprocessing
import os
import resource
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

import maira_qp as mq
from maira_qp.solvers.reachability import reachability


def seconds_of_processors() -> float:
    """Of this process and of those that it has waited for."""
    kinds = resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN
    return sum(resource.getrusage(kind).ru_utime + resource.getrusage(kind).ru_stime for kind in kinds)


def timed(name: str, poses: int, work: Callable[[], object]) -> None:
    """Print what some work takes."""
    wall, used = time.perf_counter(), seconds_of_processors()
    work()
    wall, used = time.perf_counter() - wall, seconds_of_processors() - used
    print(f"{name:34} {wall:8.2f} s  {used:8.2f} s of processors  {1e6 * used / poses:6.3f} us per pose", flush=True)


def compute(job: mq.scale.ReachJob, first: int, last: int) -> None:
    """The job's own function on some cells, in parts as long as those of workers, and nothing else."""
    for k in range(first, last, 5000):
        job.compute(k, min(k + 5000, last), 1)


def by_two(job: mq.scale.ReachJob) -> None:
    """The job's function by two processes, half of the cells each."""
    context, middle = multiprocessing.get_context("spawn"), job.count // 2
    ends = (0, middle), (middle, job.count)
    processes = [context.Process(target=compute, args=(job, *each)) for each in ends]
    for process in processes:
        process.start()
    for process in processes:
        process.join()


def compare_two(job: mq.scale.ReachJob, folder: str, rounds: int = 3) -> None:
    """Two workers beside two bare processes, by turns: the median of the shares of their speeds."""
    shares = []
    for k in range(rounds):
        begin = time.perf_counter()
        by_two(job)
        middle = time.perf_counter()
        mq.scale.run(job, Path(folder, f"two {k}"), workers=2)
        end = time.perf_counter()
        shares.append((middle - begin) / (end - middle))
        print(f"two bare processes {middle - begin:.2f} s, two workers {end - middle:.2f} s", flush=True)
    load = os.getloadavg()[0]
    print(f"two workers: {np.median(shares):.2f} of the speed of two bare processes; load of the machine {load:.1f}")


def maps() -> None:
    """Whole maps by one process, output included."""
    box = [(-1.05, 1.05)] * 3
    for name, height in (("maira", 0.438), ("panda", 0.333)):
        centred = [*box[:2], (height - 1.05, height + 1.05)]
        job = mq.scale.ReachJob.of(mq.Robot.load(name), cell=0.05, directions=200, box=centred)
        poses = job.count * job.units_per_item
        with tempfile.TemporaryDirectory() as folder:
            timed(f"{name}, {poses} poses", poses, lambda: mq.scale.run(job, Path(folder, "map"), engine="here"))  # noqa: B023
        print(f"load of the machine {os.getloadavg()[0]:.1f}", flush=True)


def poses_of(job: mq.scale.ReachJob) -> np.ndarray:
    """All poses of a grid (N, 4, 4)."""
    T = np.zeros((job.count, job.units_per_item, 4, 4))
    T[..., :3, :3] = job.orientations.rotations.reshape(-1, 3, 3)
    T[..., :3, 3], T[..., 3, 3] = job.positions.centres(0, job.count)[:, None], 1.0
    return T.reshape(-1, 4, 4)


def main() -> None:
    """Measure at so many millions of poses: 1, or what the command line says."""
    if sys.argv[1:] == ["maps"]:
        maps()
        return
    millions = float(sys.argv[1]) if len(sys.argv) > 1 else 1.0
    robot = mq.Robot.maira()
    half, directions = 1.05, 200
    cell = 2.1 / max(1, round((millions * 1e6 / directions) ** (1 / 3)))
    box = [(-half, half), (-half, half), (0.438 - half, 0.438 + half)]
    job = mq.scale.ReachJob.of(robot, cell=cell, directions=directions, box=box)
    poses, solver = job.count * directions, mq.Solver(robot)
    print(f"{poses} poses of MAIRA: {job.shape} cells of {cell:.3f} m, {directions} directions; {os.cpu_count()} CPUs")
    job.compute(0, 1, 1)  # what is made once
    targets = poses_of(mq.scale.ReachJob.of(robot, cell=cell * (millions ** (1 / 3)), directions=directions, box=box))
    reachability(solver, targets[:100], threads=1)
    timed(f"bare kernel, {len(targets)} poses", len(targets), lambda: reachability(solver, targets, threads=1))
    timed("the job's function", poses, lambda: compute(job, 0, job.count))
    with tempfile.TemporaryDirectory() as folder:
        for engine, workers in (("here", None), ("processes", 1), ("processes", 2)):
            place = Path(folder, f"{engine}{workers}")
            name = f"run, {engine}{f', {workers} workers' if workers else ''}"
            timed(name, poses, lambda: mq.scale.run(job, place, engine=engine, workers=workers))  # noqa: B023
        compare_two(job, folder)
        reach = mq.scale.ReachMap.open(place)
        fresh = reachability(solver, asked := random_poses(100_000), threads=1).verdict
        reach.query(asked[:10])
        timed("query of 100000 random poses", len(asked), lambda: reach.query(asked))
        judge(reach.query(asked), fresh)


def random_poses(count: int) -> np.ndarray:
    """Poses (N, 4, 4) uniform over the box of the map and over all rotations."""
    from scipy.spatial.transform import Rotation

    T = np.tile(np.eye(4), (count, 1, 1))
    T[:, :3, :3] = Rotation.random(count, random_state=1).as_matrix()
    T[:, :3, 3] = np.random.default_rng(2).uniform(-1.05, 1.05, (count, 3))
    T[:, 2, 3] += 0.438
    return T


def judge(said: np.ndarray, true: np.ndarray) -> None:
    """Print how often a map is right about poses that are not its own."""
    said, true = said == mq.Reach.REACHABLE, true == mq.Reach.REACHABLE
    accuracy, wrong = np.mean(said == true), np.mean(said[~true])
    precision, recall = np.mean(true[said]), np.mean(said[true])
    print(f"accuracy {accuracy:.4f}, false positives {wrong:.4f}, precision {precision:.4f}, recall {recall:.4f}")


if __name__ == "__main__":
    main()
