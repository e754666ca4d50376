"""The manifest of a job in its folder: which job it is, so that the folder can be gone on with and read by others."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from maira_qp.errors import JobError, shown
from maira_qp.io.atomic_write import replace_text
from maira_qp.regular_files import read_text
from maira_qp.scale.job import Job, job_of, versions
from maira_qp.scale.ownership import LOCK

MANIFEST = "job.json"
OURS = (f"{MANIFEST}.", LOCK)
"""What the names of files begin with that a folder may hold before its manifest."""
LARGEST = 64 * 2**20
"""Largest manifest [bytes]."""


def read_manifest(folder: Path) -> dict[str, Any]:
    """The manifest of a folder. Raises `JobError` if there is none, or none that can be read."""
    path = folder / MANIFEST
    if not path.exists():
        raise JobError(f"{folder} holds no job: there is no {MANIFEST}")
    try:
        manifest = json.loads(read_text(path, "the manifest", JobError, LARGEST))
    except (json.JSONDecodeError, RecursionError) as reason:
        raise JobError(f"{path} is damaged: {reason}") from None
    kinds = {"format": int, "kind": str, "versions": dict, "job": dict}
    if not isinstance(manifest, dict) or not all(isinstance(manifest.get(name), kinds[name]) for name in kinds):
        raise JobError(f"{path} is no manifest of a job")
    if manifest["format"] != 1:
        raise JobError(f"{path} has format {shown(manifest['format'])}; this package knows format 1")
    return manifest


def job_in(folder: Path) -> Job:
    """The job of a folder, to be gone on with. Raises `JobError`, also where other versions have begun it."""
    manifest = read_manifest(folder)
    check_versions(manifest, folder)
    return job_of(manifest)


def begin(job: Job, folder: Path) -> dict[str, Any]:
    """Write the manifest of a job into its folder, or check that it is there; returns it.

    Raises `JobError` for a folder with another job, or with other things, and for a job that other versions have begun.
    """
    manifest, path = job.manifest(), folder / MANIFEST
    if not path.exists():
        others = sorted(entry.name for entry in folder.iterdir() if not entry.name.startswith(OURS))
        if others:
            raise JobError(f"{folder} is not empty and holds no job: it has {others[0]!r}; choose another folder")
        replace_text(path, json.dumps(manifest, indent=2, allow_nan=False) + "\n")
        return manifest
    there = read_manifest(folder)
    if there["kind"] != manifest["kind"]:
        raise JobError(f"{folder} holds a job {there['kind']!r}, not {manifest['kind']!r}; choose another folder")
    if there["job"] != manifest["job"]:
        raise JobError(f"{folder} holds another job: {_difference(there['job'], manifest['job'])}")
    check_versions(there, folder)
    return there


def check_versions(manifest: Mapping[str, Any], folder: Path) -> None:
    """Raises `JobError` if a job was begun by other versions than those that are installed here."""
    there, here = manifest["versions"], versions()
    changed = [name for name in here if there.get(name) != here[name]]
    if set(changed) - {"maira-qp"}:  # of that the sources decide: in a clone, each commit has a version of its own
        each = ", ".join(f"{_name(name)} {there.get(name)}, here {here[name]}" for name in changed)
        raise JobError(
            f"the job in {folder} was begun by other versions: {each}. Its parts would not fit together: "
            "finish it with those versions, or begin in another folder"
        )


def _name(library: str) -> str:
    return "the source of maira-qp" if library == "source" else library


def _difference(there: Mapping[str, Any], here: Mapping[str, Any]) -> str:
    """The first fields that differ, for a message."""
    names = [name for name in {**there, **here} if there.get(name) != here.get(name)]
    return "; ".join(f"{name} is {shown(there.get(name))} there and {shown(here.get(name))} here" for name in names[:3])
