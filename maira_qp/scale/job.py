"""Jobs: what is to be computed, as frozen data. Any part of one is a pure function of the job and a range of items.

A job has `count` items: cells of a map, rows of a table. What it computes for a range of them depends on the job and
the range alone, whoever computes it and however the items are cut into ranges. Its output is made of blocks of items of
a fixed length, which has nothing to do with how the work was cut: so the output is the same, byte for byte.
"""

from __future__ import annotations

import hashlib
import json
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import asdict
from functools import cache
from importlib import import_module, metadata
from importlib.resources import files
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from maira_qp.errors import JobError, listed
from maira_qp.version import __version__

KINDS = {"reach": "maira_qp.scale.reach.job:ReachJob", "dataset": "maira_qp.scale.dataset.job:DatasetJob"}
"""The jobs of this package by their names, each a module and a class."""
LIBRARIES = ("numpy", "numba", "scipy", "pin")
"""Whose versions may change the last bits of an answer."""


class Job(ABC):
    """What is to be computed. A subclass is a frozen dataclass whose fields are plain data: numbers, text, tuples.

    For work in other processes the class has to be importable there.
    """

    kind: ClassVar[str]
    """The name of its class in manifests."""
    unit: ClassVar[str] = "items"
    """What progress is counted in."""

    @property
    @abstractmethod
    def count(self) -> int:
        """How many items there are."""

    @property
    @abstractmethod
    def block(self) -> int:
        """How many items a block of the output has; the last may have fewer."""

    @property
    def units_per_item(self) -> int:
        """How many units, see `unit`, an item counts for."""
        return 1

    @abstractmethod
    def compute(self, first: int, last: int, threads: int) -> dict[str, np.ndarray]:
        """Arrays (last - first, ...) of the items first, ..., last - 1, by name; no answer depends on `threads`."""

    @abstractmethod
    def begin_output(self, folder: Path) -> None:
        """Make in a folder what the output has beside its blocks; a second time too. Raises `OSError`."""

    @abstractmethod
    def write_block(self, folder: Path, first: int, arrays: Mapping[str, np.ndarray]) -> None:
        """Write the block that begins with item `first`; a second time too. Raises `OSError`."""

    @abstractmethod
    def end_output(self, folder: Path) -> None:
        """Write what tells of the output as a whole. Raises `OSError`."""

    def is_sound(self) -> bool:
        """Whether the fields, as a manifest has them, are such as a job has; it need not find every mistake."""
        return self.count >= 1 and self.block >= 1

    def as_dict(self) -> dict[str, Any]:
        """The fields, for a manifest."""
        return json.loads(json.dumps(asdict(self)))  # type: ignore[call-overload]

    def manifest(self) -> dict[str, Any]:
        """All that the result depends on: the job, and the versions of what computes it."""
        return {"format": 1, "kind": self.kind, "versions": dict(versions()), "job": self.as_dict()}


def digest_of(manifest: Mapping[str, Any]) -> str:
    """The name of a job: a checksum of all that its result depends on."""
    return hashlib.sha256(json.dumps(manifest, sort_keys=True, allow_nan=False).encode()).hexdigest()


def job_of(manifest: Mapping[str, Any]) -> Job:
    """The job of a manifest. Raises `JobError` for a kind that this package does not know, and for other fields."""
    kind = manifest["kind"]
    if kind not in KINDS:
        raise JobError(f"no job {kind!r} is known here; {listed(KINDS, kind)}")
    module, _, name = KINDS[kind].partition(":")
    try:
        job = getattr(import_module(module), name)(**manifest["job"])
        is_sound = job.is_sound()
    except (TypeError, ValueError, ArithmeticError) as reason:
        raise JobError(f"the manifest does not describe a job {kind!r}: {reason}") from None
    if not is_sound:
        raise JobError(f"the manifest does not describe a job {kind!r}: a field holds what none of them can")
    return job


@cache
def versions() -> Mapping[str, str]:
    """Versions of this package and of the libraries below it, and a checksum of this package's sources."""
    return {"maira-qp": __version__, **{name: _version(name) for name in LIBRARIES}, "source": source_digest()}


def _version(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return "unknown"


def source_digest() -> str:
    """A checksum of the sources that an answer may depend on: all of the package but `apps`."""
    total = hashlib.sha256()
    package = Path(str(files("maira_qp")))
    for path in sorted(package.rglob("*.py")):
        name = path.relative_to(package).as_posix()
        if not name.startswith("apps/"):
            content = path.read_bytes()
            total.update(f"{name} {len(content)} ".encode() + content)
    return total.hexdigest()[:16]
