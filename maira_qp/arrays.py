"""Arrays from callers, checked once at the door: native float64, the right shape, finite."""

from __future__ import annotations

import math
from collections.abc import Mapping
from enum import Enum
from typing import Any

import numpy as np

from maira_qp.errors import MairaError


def real_array(
    value: Any, shape: tuple[int | None, ...], name: str, error: type[MairaError], *, finite: bool | None = True
) -> np.ndarray:
    """A fresh float64 array of the given shape (None: any length) from what a caller passed.

    Raises `error` for strings, objects, booleans and complex numbers, for another shape, and for what
    is not finite; with `finite` False for NaN only, with None for neither.
    """
    try:
        raw = np.asarray(value)
    except (TypeError, ValueError) as reason:
        raise error(f"{name} is not an array of numbers: {reason}") from None
    if raw.dtype.kind not in "iuf":
        raise error(f"{name} must hold real numbers, not {raw.dtype.name} ({value!r:.80})")
    array = np.array(raw, dtype=np.float64, order="C")
    if len(array.shape) != len(shape) or any(s not in (None, n) for s, n in zip(shape, array.shape, strict=True)):
        wanted = "(" + ", ".join("any" if s is None else str(s) for s in shape) + ("," if len(shape) == 1 else "") + ")"
        raise error(f"{name} must have shape {wanted}, not {array.shape}")
    if finite is not None and (np.isnan(array).any() or (finite and not np.isfinite(array).all())):
        raise error(f"{name} must be finite, got {np.array2string(array, threshold=20, precision=4)}")
    return array


def is_native(value: Any, shape: tuple[int, ...]) -> bool:
    """Whether compiled code can take a value as it is: a C-contiguous float64 array of that shape, finite or not."""
    return type(value) is np.ndarray and value.dtype == np.float64 and value.shape == shape and value.flags.c_contiguous


def plain(value: Any) -> Any:
    """The same in what JSON knows: arrays and tuples as lists, enums as their names, numbers that are not finite as
    None."""
    if isinstance(value, Mapping):
        return {str(key): plain(entry) for key, entry in value.items()}
    if isinstance(value, Enum):
        return value.name
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, (list, tuple)):
        return [plain(entry) for entry in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
