"""How every kernel is compiled: once per machine, without the global interpreter lock."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any

import numpy as np
from numba import config, njit


def kernel(function: Callable) -> Any:
    """Compile a function with Numba, kept on disk where there is a folder to write to.

    Division follows IEEE 754; of the fast-math flags only contraction to fused multiply-add is on, so NaN stays NaN.
    """
    return _compiled(function)


def bare_kernel(function: Callable) -> Any:
    """The same for a function that makes no array: it then counts no references, which costs as much as the work."""
    return _compiled(function, _nrt=False)


def inner_kernel(function: Callable) -> Any:
    """A bare kernel that other kernels alone call, as they do all whose names begin with an underscore.

    It has no entry from Python, which for many or large arguments takes as long to compile as the kernel.
    """
    return _compiled(function, _nrt=False, no_cpython_wrapper=True)


def _compiled(function: Callable, **options: Any) -> Any:
    if config.DISABLE_JIT:
        return _silent(function)
    options.setdefault("no_cpython_wrapper", function.__name__.startswith("_"))
    options |= {"nogil": True, "error_model": "numpy", "fastmath": {"contract"}, "no_cfunc_wrapper": True}
    try:
        return njit(cache=True, **options)(function)
    except RuntimeError:  # no folder for the cache: a read-only package and no home
        return njit(**options)(function)


def _silent(function: Callable) -> Callable:
    """The plain function, whose arithmetic warns as little as compiled code does."""

    @wraps(function)
    def silent(*arguments: Any) -> Any:
        with np.errstate(all="ignore"):
            return function(*arguments)

    return silent
