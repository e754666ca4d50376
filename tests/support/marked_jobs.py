"""A small job whose items can be made to go wrong, once or always, where a test says so: no clock is waited for."""

import os
import signal
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from maira_qp.io.atomic_write import replacing
from maira_qp.scale import Job


@dataclass(frozen=True, kw_only=True)
class MarkedJob(Job):
    """Numbers that depend on the item alone. Each accident happens once an item, in the process that computes it."""

    count: int = 60  # pyright: ignore
    block: int = 7  # pyright: ignore
    marks: str = ""
    """Folder of marks: what has happened, and the processes that computed something"""
    killed: tuple[int, ...] = ()
    hanging: tuple[int, ...] = ()
    broken: tuple[int, ...] = ()
    """Raises each time"""
    deadly: tuple[int, ...] = ()
    """Kills each time"""
    writer_killed: tuple[int, ...] = ()
    """Is killed over the blocks that begin there"""
    waits_at: int = -1
    """Waits there until it is killed"""

    kind = "marked"

    def compute(self, first: int, last: int, threads: int) -> dict[str, np.ndarray]:
        """The numbers, or an accident."""
        for item in range(first, last):
            if item in self.deadly or (item in self.killed and self._is_first(f"killed-{item}")):
                os.kill(os.getpid(), signal.SIGKILL)
            if (item in self.hanging and self._is_first(f"hung-{item}")) or item == self.waits_at:
                self._is_first(f"waiting-{item}")
                while True:
                    time.sleep(60)
            if item in self.broken:
                raise ArithmeticError(f"item {item} cannot be")
        index = np.arange(first, last)
        return {"index": index, "value": np.sin(index * 0.7)[:, None] * np.arange(3)}

    def _is_first(self, name: str) -> bool:
        try:
            Path(self.marks, name).touch(exist_ok=False)
        except FileExistsError:
            return False
        return True

    def begin_output(self, folder: Path) -> None:
        """Remove what a run before has left."""
        for file in folder.glob("block-*"):
            file.unlink()

    def write_block(self, folder: Path, first: int, arrays: Mapping[str, np.ndarray]) -> None:
        """A file a block."""
        with replacing(folder / f"block-{first:06d}") as file:
            if first in self.writer_killed and self._is_first(f"writer-killed-{first}"):
                file.write(b"begun")
                file.flush()
                Path(folder, f"block.{first}.partial").touch()
                os.kill(os.getpid(), signal.SIGKILL)
            file.write(arrays["index"].tobytes() + arrays["value"].tobytes())

    def end_output(self, folder: Path) -> None:
        """A file that says so."""
        with replacing(folder / "end") as file:
            file.write(b"whole\n")


def files_of(folder: Path) -> dict[str, bytes]:
    """All files below a folder, by their relative names."""
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}
