"""The files of a data set, laid out as LeRobot's format 3 has it: Parquet below `data`, `meta/info.json` beside.

No file is larger than 100 MB, and no folder has more than 1,000 of them.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from maira_qp.io.atomic_write import replace_text, replacing
from maira_qp.io.parquet_table import check_pyarrow, write_parquet
from maira_qp.io.table import ColumnTable

FILES = 1000
"""Files of a folder."""
MEGABYTES = 100
"""A file has at most."""
DATA_PATH = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"


def begin(folder: Path) -> None:
    """Remove what a run before has left. Raises `OptionError` without pyarrow."""
    check_pyarrow()
    for name in ("data", "meta"):
        shutil.rmtree(folder / name, ignore_errors=True)


def write(folder: Path, k: int, columns: Mapping[str, np.ndarray]) -> None:
    """Write the k-th file. Raises `OSError`."""
    with replacing(folder / DATA_PATH.format(chunk_index=k // FILES, file_index=k % FILES)) as file:
        write_parquet(file, ColumnTable(columns), {})


def end(folder: Path, count: int, seed: int, about: Mapping[str, Any]) -> None:
    """Write what tells of all `count` files. Raises `OSError`."""
    from pyarrow import parquet

    paths = [folder / DATA_PATH.format(chunk_index=k // FILES, file_index=k % FILES) for k in range(count)]
    schema = parquet.read_schema(paths[0])
    info = {
        "codebase_version": "v3.0",
        "total_frames": sum(parquet.read_metadata(path).num_rows for path in paths),
        "total_files": count,
        "chunks_size": FILES,
        "data_files_size_in_mb": MEGABYTES,
        "data_path": DATA_PATH,
        "features": {field.name: {"dtype": _dtype(str(field.type)), "shape": [1]} for field in schema},
        "seed": seed,
        "maira_qp": dict(about),
    }
    replace_text(folder / "meta" / "info.json", json.dumps(info, indent=2, allow_nan=False) + "\n")


def _dtype(arrow: str) -> str:
    return {"double": "float64"}.get(arrow, arrow)
