"""How every kernel is compiled: once per machine, without the global interpreter lock."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any

import numpy as np
from numba import config, njit

from maira_qp.kernels.jit.code_cache import CodeCache
from maira_qp.kernels.jit.inlining import INLINE, EntryCompiler, part

OPTIONS: dict[str, Any] = {"nogil": True, "error_model": "numpy", "fastmath": {"contract"}, "no_cfunc_wrapper": True}


def kernel(function: Callable) -> Any:
    """Compile a function with Numba, kept on disk where there is a folder to write to.

    Division follows IEEE 754; of the fast-math flags only contraction to fused multiply-add is on, so NaN stays NaN.
    Where other kernels call it, it is a part of them, compiled with them: see `kernels.jit.inlining`.
    """
    return _compiled(function)


def bare_kernel(function: Callable) -> Any:
    """The same for a function that makes no array: it then counts no references, which costs as much as the work."""
    return _compiled(function, _nrt=False)


def inner_kernel(function: Callable) -> Any:
    """A bare kernel that other kernels alone call, as they do all whose names begin with an underscore."""
    return _compiled(function, is_inner=True, _nrt=False)


def _compiled(function: Callable, *, is_inner: bool = False, **options: Any) -> Any:
    """What Python calls, and what takes its place in other kernels; each is compiled when it is first called."""
    if config.DISABLE_JIT:
        return _silent(function)
    options |= OPTIONS
    inner = part(function, options) if INLINE else njit(**options)(function)
    if is_inner or function.__name__.startswith("_"):
        return inner
    entry: Any = njit(**options, pipeline_class=EntryCompiler)(function) if INLINE else inner
    entry._cache = CodeCache(function)
    if INLINE:
        entry.get_call_template, entry.get_overload = inner.get_call_template, inner.get_overload
    return entry


def _silent(function: Callable) -> Callable:
    """The plain function, whose arithmetic warns as little as compiled code does."""

    @wraps(function)
    def silent(*arguments: Any) -> Any:
        with np.errstate(all="ignore"):
            return function(*arguments)

    return silent
