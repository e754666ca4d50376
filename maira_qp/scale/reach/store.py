"""A reachability map as a Zarr store (format 3): one array a quantity, with its metadata in one place, for anyone."""

from __future__ import annotations

import importlib.util
import shutil
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from maira_qp.errors import OptionError
from maira_qp.results.status import Reach
from maira_qp.scale.reach.grid import Orientations, Positions

AXES = ("x", "y", "z")


class Quantity(NamedTuple):
    """What is known of each cell."""

    dtype: str
    units: str
    meaning: str


CELLS = {
    "reachable": Quantity("float32", "1", "share of the orientations that were reached"),
    "unreachable": Quantity("float32", "1", "share of the orientations that are proved to be out of reach"),
    "undecided": Quantity("float32", "1", "share of the orientations that are neither"),
    "directions_open": Quantity("uint32", "1", "directions of the tool's z axis that are reached at some roll"),
    "manipulability": Quantity("float32", "", "largest manipulability of the configurations found; NaN: none was"),
    "limit_distance": Quantity(
        "float32",
        "1",
        "largest distance from the nearest joint limit, in half ranges, of the configurations found; NaN: none was",
    ),
}
"""Arrays over x, y and z."""
VERDICT = "verdict"
"""The array over x, y, z, direction and roll: values of `Reach`."""


def check_zarr() -> None:
    """Whether maps can be written and read. Raises `OptionError`."""
    if importlib.util.find_spec("zarr") is None:
        raise OptionError("maps need zarr: pip install 'maira-qp[scale]' (Python 3.11 or newer)")


def begin(
    folder: Path, positions: Positions, orientations: Orientations, block: int, attributes: Mapping[str, Any]
) -> None:
    """Make the arrays of a map, without their values, and the coordinates. Raises `OptionError`, `OSError`."""
    check_zarr()
    import zarr

    shape = positions.shape
    chunk = (block // (shape[1] * shape[2]), shape[1], shape[2])
    turned = (orientations.directions, orientations.rolls)
    for name in (*CELLS, VERDICT, *AXES, "direction_vector", "roll_angle"):
        shutil.rmtree(folder / name, ignore_errors=True)
    with _quiet():
        group = zarr.open_group(folder, mode="a", zarr_format=3, attributes=dict(attributes))
        for name, quantity in CELLS.items():
            about = {"long_name": quantity.meaning, "units": quantity.units}
            _make(group, name, shape, chunk, quantity.dtype, AXES, about)
        names = " ".join(kind.name for kind in Reach)
        about = {"flag_values": [int(kind) for kind in Reach], "flag_meanings": names}
        _make(group, VERDICT, (*shape, *turned), (*chunk, *turned), "int8", (*AXES, "direction", "roll"), about)
        for k, name in enumerate(AXES):
            about = {"long_name": "centres of the cells", "units": "m"}
            _put(group, name, positions.axis(k), (name,), about)
        about = {"long_name": "unit vectors of the tool's z axis in the base", "units": "1"}
        _put(group, "direction_vector", orientations.vectors, ("direction", "axis"), about)
        about = {"long_name": "angles about the tool's z axis", "units": "rad"}
        _put(group, "roll_angle", orientations.angles, ("direction", "roll"), about)


def write_block(folder: Path, positions: Positions, first: int, arrays: Mapping[str, np.ndarray]) -> None:
    """Write the values of whole planes of cells, from cell `first` on. Raises `OSError`."""
    import zarr

    plane = positions.shape[1] * positions.shape[2]
    with _quiet():
        group: Any = zarr.open_group(folder, mode="r+")
        for name, values in arrays.items():
            planes = values.reshape(-1, *positions.shape[1:], *values.shape[1:])
            group[name][first // plane : first // plane + len(planes)] = planes


def end(folder: Path) -> None:
    """Put the metadata of all arrays into one place. Raises `OSError`."""
    import zarr

    with _quiet():
        zarr.consolidate_metadata(zarr.storage.LocalStore(folder), zarr_format=3)


def open_arrays(folder: Path) -> Any:
    """The group of a map's arrays, to be read. Raises `OSError`."""
    check_zarr()
    import zarr

    with _quiet():
        return zarr.open_group(folder, mode="r")


def _make(
    group: Any,
    name: str,
    shape: tuple[int, ...],
    chunk: tuple[int, ...],
    dtype: str,
    dimensions: tuple[str, ...],
    attributes: Mapping[str, Any],
) -> Any:
    return group.create_array(
        name,
        shape=shape,
        chunks=chunk,
        dtype=dtype,
        dimension_names=dimensions,
        attributes=dict(attributes),
        fill_value=float("nan") if dtype.startswith("float") else 0,
        config={"write_empty_chunks": True},
    )


def _put(group: Any, name: str, values: np.ndarray, dimensions: tuple[str, ...], attributes: Mapping[str, Any]) -> None:
    _make(group, name, values.shape, values.shape, values.dtype.name, dimensions, attributes)[...] = values


@contextmanager
def _quiet() -> Iterator[None]:
    """Without warnings of consolidated metadata, which format 3 has yet to specify, and of files beside the arrays."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*not recognized as a component", category=UserWarning)
        warnings.filterwarnings("ignore", message=".*onsolidated metadata", category=UserWarning)
        yield
