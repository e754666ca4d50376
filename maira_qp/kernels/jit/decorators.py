"""How every kernel is compiled: once per machine, without the global interpreter lock."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial, wraps
from typing import Any

import numpy as np
from numba import config, njit

from maira_qp.kernels.jit.code_cache import CodeCache
from maira_qp.kernels.jit.inlining import INLINE, EntryCompiler, part

OPTIONS: dict[str, Any] = {"nogil": True, "error_model": "numpy", "fastmath": {"contract"}, "no_cfunc_wrapper": True}


def kernel(function: Callable | None = None, *, allocates: bool = False) -> Any:
    """Compile a function with Numba for Python and for other kernels; kept on disk where there is a folder to write to.

    Division follows IEEE 754; of the fast-math flags only contraction to fused multiply-add is on, so NaN stays NaN.
    Where other kernels call it, it is a part of them, compiled with them: see `kernels.jit.inlining`. A kernel that
    makes arrays `allocates`; the others count no references, which can cost as much as the work.
    """
    if function is None:
        return partial(kernel, allocates=allocates)
    if config.DISABLE_JIT:
        return _silent(function)
    options, inner = _options(allocates), device_kernel(function, allocates=allocates)
    entry: Any = njit(**options, pipeline_class=EntryCompiler)(function) if INLINE else inner
    entry._cache = CodeCache(function)
    if INLINE:
        entry.get_call_template, entry.get_overload = inner.get_call_template, inner.get_overload
    return entry


def device_kernel(function: Callable | None = None, *, allocates: bool = False) -> Any:
    """The same for a function that other kernels alone call: a part of them, and nothing of its own."""
    if function is None:
        return partial(device_kernel, allocates=allocates)
    if config.DISABLE_JIT:
        return _silent(function)
    return part(function, _options(allocates)) if INLINE else njit(**_options(allocates))(function)


def _options(allocates: bool) -> dict[str, Any]:
    """Numba's options."""
    return OPTIONS if allocates else OPTIONS | {"_nrt": False}


def _silent(function: Callable) -> Callable:
    """The plain function, whose arithmetic warns as little as compiled code does."""

    @wraps(function)
    def silent(*arguments: Any) -> Any:
        with np.errstate(all="ignore"):
            return function(*arguments)

    return silent
