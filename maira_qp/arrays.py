"""Numbers and arrays from callers, checked once at the door: native float64, the right shape, finite."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from enum import Enum
from typing import Any

import numpy as np

from maira_qp.errors import MairaError, shown

LARGEST_COUNT = 10**9
"""Largest whole number that an option can be."""
LARGEST_SIZE = 2 * 10**9
"""Most numbers of an array."""


def real_array(
    value: Any, shape: tuple[int | None, ...], name: str, error: type[MairaError], *, finite: bool | None = True
) -> np.ndarray:
    """A fresh float64 array of the given shape (None: any length) from what a caller passed.

    Raises `error` for strings, objects, booleans and complex numbers, for another shape, and for what
    is not finite; with `finite` False for NaN only, with None for neither.
    """
    if _claimed_size(value) > LARGEST_SIZE:  # nested aliases of one list can mean terabytes
        raise error(f"{name} holds more than {LARGEST_SIZE} numbers: {shown(value)}")
    try:
        raw = np.asarray(value)
        masked = np.ma.is_masked(value) or (isinstance(value, (list, tuple)) and any(map(np.ma.is_masked, value)))
    except Exception as reason:  # ragged lists, and whatever a class of the caller's own raises
        raise error(f"{name} is not an array of numbers: {reason!s:.300}") from None
    if raw.dtype.kind not in "iuf":
        raise error(f"{name} must hold real numbers, not {raw.dtype.name} ({shown(value)})")
    if masked:
        raise error(f"{name} must hold numbers throughout: entries of it are masked")
    with np.errstate(over="ignore"):  # of what is longer than a double
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


def is_number(value: Any) -> bool:
    """Whether a value is one real number that a float can hold, infinite or not: no bool, no text, not complex."""
    if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
        return False
    try:
        return not math.isnan(float(value))
    except OverflowError:
        return False


def is_listing(value: Any) -> bool:
    """Whether a value holds others in an order: neither text nor a mapping, nor an array without a dimension."""
    scalar = isinstance(value, np.ndarray) and not value.ndim
    return isinstance(value, Iterable) and not (isinstance(value, (str, bytes, Mapping)) or scalar)


def check_callable(value: Any, name: str, error: type[MairaError]) -> None:
    """Raises `error` for what cannot be called, unless it is None."""
    if value is not None and not callable(value):
        raise error(f"{name} must be a function, got {shown(value)}")


def _claimed_size(value: Any) -> int:
    """So many numbers nested lists hold, if all are like the first ones."""
    size = 1
    while isinstance(value, (list, tuple)) and value and size <= LARGEST_SIZE:
        size, value = size * len(value), value[0]
    return size


def is_count(value: Any, least: int = 0, largest: int = LARGEST_COUNT) -> bool:
    """Whether a value is a whole number in that range, as an integer or as a float."""
    return is_number(value) and least <= value <= largest and value == int(value)


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
