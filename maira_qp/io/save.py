"""Paths and trajectories into files: tables, JSON, ROS 2's `trajectory_msgs/JointTrajectory`, logs for Rerun's viewer.

Each file is written beside its place and renamed into it, so that there is a whole file or none.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from maira_qp.errors import OptionError, listed, shown
from maira_qp.io.atomic_write import replacing
from maira_qp.io.csv_table import write_csv
from maira_qp.io.npy_table import write_npy
from maira_qp.io.npz_table import write_npz
from maira_qp.io.parquet_table import check_pyarrow, write_parquet
from maira_qp.io.rerun_log import check_rerun, write_rerun
from maira_qp.io.ros_messages import joint_trajectory
from maira_qp.io.table import ColumnTable
from maira_qp.results.path_solution import PathSolution
from maira_qp.results.trajectory import Trajectory

Motion = PathSolution | Trajectory

ENDINGS = {
    ".ros.json": "ros",
    ".csv": "csv",
    ".npy": "npy",
    ".npz": "npz",
    ".parquet": "parquet",
    ".json": "json",
    ".rrd": "rerun",
}
"""Formats by the end of a file's name, the longer ends first."""


@dataclass(frozen=True)
class TableUnits:
    """Units of a table: radians and metres, or degrees, millimetres, which its headings then say."""

    degrees: bool = False
    millimetres: bool = False

    def heading(self, name: str, slides: bool, per: str = "") -> str:
        """A heading, such as "q_joint1 [deg]": with the unit where it is not rad or m."""
        unit = ("mm" if self.millimetres else "") if slides else ("deg" if self.degrees else "")
        return f"{name} [{unit}{per}]" if unit else name

    def scale(self, slides: Any) -> Any:
        """What 1 m, of what `slides`, or 1 rad is in these units; like `slides` a bool, or an array of them."""
        return np.where(slides, 1e3 if self.millimetres else 1.0, 180.0 / math.pi if self.degrees else 1.0)


SI = TableUnits()
OF_LENGTH, OF_ANGLE = {"position_error": "", "tool_speed": "/s"}, {"orientation_error": ""}
OF_JOINTS = {"q": "", "velocity": "/s", "acceleration": "/s^2"}
"""Columns with units, and what of time these are by."""


def save(
    result: Motion,
    file: str | os.PathLike[str],
    format: str | None = None,
    *,
    degrees: bool = False,
    millimetres: bool = False,
) -> Path:
    """Write a path or a trajectory to a file, whole or not at all; missing folders are made. Returns its path.

    CSV and Parquet have a row for each pose or sample, NPY an array with their columns as fields; NPZ has the same as
    arrays, with q (N, n) and `joint_names`; JSON is `result.as_dict()`. Units are those of the result: m, rad, s,
    unless other ones are asked for.

    Args:
        result: a `PathSolution` or `Trajectory`.
        file: path to write to.
        format: "csv", "npy", "npz", "parquet", "json", "ros" or "rerun"; None: by the end of the file's name, .csv,
            .npy, .npz, .parquet, .json, .ros.json or .rrd. "ros": the message `trajectory_msgs/JointTrajectory` as
            JSON; of a path it needs the times that `track(..., dt=...)` says. "rerun": joints, errors and the arm over
            time for the Rerun viewer (`maira-qp[rerun]`).
        degrees: angles of CSV, NPY, NPZ and Parquet in degrees, as headings such as "q_joint1 [deg]" say, of NPZ the
            array `q_units`. JSON, ROS and Rerun have radians always.
        millimetres: lengths of these in millimetres, as headings say.

    Raises `OptionError` for another format or name, a format whose extra is not installed, a path without times, and a
    pickled result for "rerun"; `OSError`.
    """
    if not isinstance(result, (PathSolution, Trajectory)):
        raise OptionError(f"save takes a PathSolution or a Trajectory, not {shown(result)}")
    if not isinstance(file, (str, os.PathLike)):
        raise OptionError(f"save takes the path of a file, not {shown(file)}")
    path = Path(file)
    format = format_of(path, format)
    with replacing(path) as opened:
        stream(result, opened, format, TableUnits(bool(degrees), bool(millimetres)))
    return path


def stream(result: Motion, file: BinaryIO, format: str, units: TableUnits = SI) -> None:
    """Write the same to a stream. Raises as `save` does."""
    WRITERS[format](file, result, units)


def format_of(path: Path, format: str | None = None) -> str:
    """In which format a file will be written. Raises `OptionError` if it cannot be."""
    if format is None:
        format = next((each for ending, each in ENDINGS.items() if path.name.lower().endswith(ending)), None)
        if format is None:
            raise OptionError(f"a path's file ends in {', '.join(sorted(ENDINGS))}, not {path.name!r}")
    if not isinstance(format, str) or format not in WRITERS:
        raise OptionError(f"no format {shown(format)}; {listed(WRITERS, format)}")
    if format == "parquet":
        check_pyarrow()
    if format == "rerun":
        check_rerun()
    return format


def columns(result: Motion) -> dict[str, np.ndarray]:
    """What there is of each pose or sample: numbers (N,), and arrays (N, n) of the joints."""
    if isinstance(result, Trajectory):
        joints = {"q": result.q, "velocity": result.velocity, "acceleration": result.acceleration}
        return {"time": result.times, "tool_speed": result.tool_speed, **joints}
    times = {} if result.rules.dt is None else {"time": result.rules.dt * np.arange(len(result))}
    return {
        "pose": np.arange(len(result)),
        **times,
        "success": result.success,
        "reconfiguration": np.isin(np.arange(len(result)), result.breaks),
        "position_error": result.position_error,
        "orientation_error": result.orientation_error,
        "q": result.q,
    }


def flat_columns(result: Motion, units: TableUnits) -> dict[str, np.ndarray]:
    """`columns` (N,) in other units, with headings that say so, and a column for each joint in place of the arrays."""
    flat, slides = {}, [unit == "m" for unit in result.q_units]
    for name, array in in_units(result, units).items():
        if name in OF_JOINTS:
            for i, joint in enumerate(result.joint_names):
                flat[units.heading(f"{name}_{joint}", slides[i], OF_JOINTS[name])] = array[:, i]
        elif name in OF_LENGTH or name in OF_ANGLE:
            flat[units.heading(name, name in OF_LENGTH, (OF_LENGTH | OF_ANGLE)[name])] = array
        else:
            flat[name] = array
    return flat


def in_units(result: Motion, units: TableUnits) -> dict[str, np.ndarray]:
    """`columns` in other units."""
    found = columns(result)
    if units == SI:
        return found
    slides = np.array([unit == "m" for unit in result.q_units])
    for name, array in found.items():
        if name in OF_JOINTS:
            found[name] = array * units.scale(slides)
        elif name in OF_LENGTH or name in OF_ANGLE:
            found[name] = array * units.scale(name in OF_LENGTH)
    return found


def _write_csv(file: BinaryIO, result: Motion, units: TableUnits) -> None:
    write_csv(file, ColumnTable(flat_columns(result, units)), {})


def _write_parquet(file: BinaryIO, result: Motion, units: TableUnits) -> None:
    write_parquet(file, ColumnTable(flat_columns(result, units)), {})


def _write_npy(file: BinaryIO, result: Motion, units: TableUnits) -> None:
    write_npy(file, ColumnTable(flat_columns(result, units)), {})


def about_joints(result: Motion, units: TableUnits) -> dict[str, np.ndarray]:
    """What an archive says of the joints (n,): their names, and their units where these are not m and rad."""
    names = {"joint_names": np.array(result.joint_names, dtype=str)}
    if units != SI:
        named = {"m": "mm" if units.millimetres else "m", "rad": "deg" if units.degrees else "rad"}
        names["q_units"] = np.array([named[unit] for unit in result.q_units])
    return names


def _write_npz(file: BinaryIO, result: Motion, units: TableUnits) -> None:
    write_npz(file, ColumnTable({}), {**in_units(result, units), **about_joints(result, units)})


def _write_json(file: BinaryIO, result: Motion, _: TableUnits) -> None:
    _dump(file, result.as_dict())


def _write_ros(file: BinaryIO, result: Motion, _: TableUnits) -> None:
    _dump(file, joint_trajectory(result.joint_names, columns(result)))


def _dump(file: BinaryIO, value: Any) -> None:
    file.write((json.dumps(value, allow_nan=False) + "\n").encode())


def _write_rerun(file: BinaryIO, result: Motion, _: TableUnits) -> None:
    values = columns(result)
    write_rerun(file, result.robot, values)


WRITERS: dict[str, Callable[[BinaryIO, Motion, TableUnits], None]] = {
    "csv": _write_csv,
    "npy": _write_npy,
    "npz": _write_npz,
    "parquet": _write_parquet,
    "json": _write_json,
    "ros": _write_ros,
    "rerun": _write_rerun,
}
