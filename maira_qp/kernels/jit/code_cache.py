"""The machine code of the kernels on disk: found again by the next process, and never older than its source.

Numba's own cache looks at the file of the function that is called, not at the kernels compiled into it. Here the
content of all kernels, and the versions and settings of what compiles them, name the folder (`KEY`): code made from
anything else is not found. The code of a kernel for types of arguments and a processor is a file of its own, whole or
absent, that begins with its checksum, so processes need not agree on anything. Whatever goes wrong with a file or a
folder is logged, and the kernel is compiled.
"""

from __future__ import annotations

import contextlib
import hashlib
import logging
import os
import pickle
import shutil
import stat
import sys
import tempfile
from collections.abc import Callable, Iterator
from importlib.resources import files
from pathlib import Path
from re import fullmatch
from typing import Any
from uuid import uuid4

import llvmlite
import numba
import numpy as np
from numba import config
from numba.core.caching import NullCache
from numba.core.compiler import CompileResult
from numba.core.serialize import dumps

from maira_qp.kernels.jit.inlining import INLINE

log = logging.getLogger(__name__)

SETTINGS = (
    "OPT",
    "LOOP_VECTORIZE",
    "SLP_VECTORIZE",
    "ENABLE_AVX",
    "USING_SVML",
    "BOUNDSCHECK",
    "DEBUGINFO_DEFAULT",
    "LLVM_REFPRUNE_PASS",
    "LLVM_REFPRUNE_FLAGS",
)
"""Numba's settings that change the code; the processor's name and features are in the name of each file."""
KEPT = 6
"""Folders of keys that are kept, the last used: other environments, and sources gone back to."""
ENDING = ".kernel"
CHECKSUM = hashlib.sha256
ANNOUNCEMENT = "compiling the engine for this machine, once: this takes some seconds"
"""What is logged when the compiler begins."""


def source_digest() -> str:
    """The content of all kernels' files; empty if the sources are not there."""
    digest = hashlib.sha256()
    sources = sorted(_sources(files("maira_qp.kernels")))
    for name, content in sources:
        digest.update(f"{name} {len(content)} ".encode() + content)
    return digest.hexdigest() if sources else ""


def _sources(folder: Any, under: str = "") -> Iterator[tuple[str, bytes]]:
    for entry in folder.iterdir():
        if entry.name.endswith(".py"):
            yield under + entry.name, entry.read_bytes()
        elif entry.is_dir() and entry.name != "__pycache__":
            yield from _sources(entry, f"{under}{entry.name}/")


SOURCES = source_digest()
"""What the kernels of this process are compiled from."""
KEY = hashlib.sha256(
    repr(
        (
            SOURCES,
            numba.__version__,
            llvmlite.__version__,
            np.__version__,
            sys.implementation.cache_tag,
            sys.version_info[:3],
            [getattr(config, name, None) for name in SETTINGS],
            INLINE,
        )
    ).encode()
).hexdigest()[:16]
"""The name of the folder that this process takes code from."""


def roots() -> list[Path]:
    """The folders that hold those of the keys: `NUMBA_CACHE_DIR`; else in the user's cache, then a temporary one.

    None if the sources are not there, as nothing would tell that they have changed.
    """
    if not SOURCES:
        return []
    if config.CACHE_DIR:
        return [Path(config.CACHE_DIR).absolute() / "maira_qp"]
    cache = Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache").expanduser()
    temporary = Path(tempfile.gettempdir()) / f"maira_qp-{os.getuid()}"
    return [root for root in (cache / "maira_qp", temporary) if root.is_absolute()]


def folders() -> list[Path]:
    """Where code of this process's key is looked for, and kept in the first that takes it."""
    return [root / KEY for root in roots()]


def writable() -> Path | None:
    """The first folder that takes code of this process's key, tried with a file; None if none does."""
    for folder in folders():
        with contextlib.suppress(OSError):
            _write(folder / "try", b"", keep=False)
            return folder
    return None


def kept() -> list[Path]:
    """The files of machine code of all keys."""
    return [file for key in _keys() for file in sorted(key.glob(f"*{ENDING}"))]


def clear() -> None:
    """Remove the machine code of all keys. Raises `OSError` where that is not allowed."""
    for key in _keys():
        shutil.rmtree(key)


def _keys() -> Iterator[Path]:
    """The folders of all keys."""
    for root in roots():
        if root.is_dir():
            yield from (folder for folder in root.iterdir() if fullmatch("[0-9a-f]{16}", folder.name))


class CodeCache(NullCache):
    """The versions of one kernel on disk, as Numba's dispatcher asks for them."""

    def __init__(self, function: Callable) -> None:
        self._name = f"{function.__module__.removeprefix('maira_qp.kernels.')}.{function.__qualname__}"

    @property
    def cache_path(self) -> Any:
        """The folder that is read first."""
        return next(map(str, folders()), None)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The kernel compiled for a signature; None if it has to be compiled, which the first time is announced."""
        target_context.refresh()
        name = self._file(sig, target_context.codegen())
        for folder in folders():
            data = _read(folder / name)
            if data is None:
                continue
            try:
                found = CompileResult._rebuild(target_context, *pickle.loads(data))
            except Exception as reason:  # whole, and of this key, but not to be loaded, whatever the reason
                log.warning("compiling %s anew: %s cannot be loaded: %r", self._name, folder / name, reason)
                continue
            _use(folder)
            return found
        _warn_once(ANNOUNCEMENT)
        return None

    def save_overload(self, sig: Any, cres: Any) -> None:
        """Keep what has been compiled for a signature, if there is room."""
        if cres.library.has_dynamic_globals or source_digest() != SOURCES:  # edited since this process began
            return
        name, content = self._file(sig, cres.codegen), dumps(cres._reduce())
        reasons = []
        for folder in folders():
            try:
                _write(folder / name, content)
                return
            except OSError as reason:
                reasons.append(str(reason))
        _warn_once("compiled code is not kept, each process compiles anew: %s", "; ".join(reasons) or "no sources")

    def _file(self, sig: Any, codegen: Any) -> str:
        """The name of the file for a signature and a processor."""
        version = repr((str(sig), codegen.magic_tuple()))
        return f"{self._name}-{hashlib.sha256(version.encode()).hexdigest()[:16]}{ENDING}"


def _read(file: Path) -> bytes | None:
    """The content of a file of the cache; None if there is none, or not whole."""
    try:
        content = file.read_bytes() if _is_ours(file.parent.parent) else b""
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError as reason:
        log.warning("compiling anew what cannot be read: %s", reason)
        return None
    data = content[CHECKSUM().digest_size :]
    if content == CHECKSUM(data).digest() + data:
        return data
    log.warning("compiling anew: %s is damaged", file)
    return None


def _write(file: Path, data: bytes, *, keep: bool = True) -> None:
    """A file of the cache, whole or not at all; or nothing but the try. Raises `OSError`."""
    folder = file.parent
    if not folder.is_dir():
        folder.parent.mkdir(mode=0o700 if _is_temporary(folder.parent) else 0o777, parents=True, exist_ok=True)
        folder.mkdir(exist_ok=True)
        _forget_old(folder.parent)
    if not _is_ours(folder.parent):
        raise PermissionError(f"others may write to {folder.parent}")
    part = folder / f".{uuid4().hex}"
    try:
        part.write_bytes(CHECKSUM(data).digest() + data)
        if keep:
            part.replace(file)
    finally:
        part.unlink(missing_ok=True)


def _is_temporary(root: Path) -> bool:
    """Whether it lies where everybody may make folders."""
    return root.parent == Path(tempfile.gettempdir())


def _is_ours(root: Path) -> bool:
    """Whether what it holds may be run: nobody else may write into it, where everybody might have made it."""
    if not _is_temporary(root):
        return True
    status = root.lstat()
    return stat.S_ISDIR(status.st_mode) and status.st_uid == os.getuid() and not status.st_mode & 0o022


def _forget_old(root: Path) -> None:
    """Remove the folders of the keys that were not used for longest."""

    def last_use(folder: Path) -> float:
        try:
            return folder.stat().st_mtime
        except OSError:  # another process was faster
            return 0.0

    for old in sorted(_keys(), key=last_use, reverse=True)[KEPT:]:
        if old.parent == root:
            shutil.rmtree(old, ignore_errors=True)


_told: set[str] = set()
"""What has been said once in this process, and which folders it uses."""


def _use(folder: Path) -> None:
    """Note that a key is in use: the time of its folder."""
    if str(folder) not in _told:
        _told.add(str(folder))
        with contextlib.suppress(OSError):  # read-only
            os.utime(folder)


def _warn_once(message: str, *arguments: Any) -> None:
    """Log what a process need say only once."""
    if message not in _told:
        _told.add(message)
        log.warning(message, *arguments)
