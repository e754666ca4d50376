"""Numbers and arrays from callers, checked once at the door: native float64, the right shape, finite."""

from __future__ import annotations

import math
import numbers
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
    value: Any,
    shape: tuple[int | None, ...],
    name: str,
    error: type[MairaError],
    *,
    finite: bool | None = True,
    wanted: str = "",
) -> np.ndarray:
    """A fresh float64 array of the given shape (None: any length) from what a caller passed.

    Raises `error` for strings, objects, booleans and complex numbers, for another shape, and for what
    is not finite; with `finite` False for NaN only, with None for neither. `wanted` says what is valid where numbers
    of that shape do not.
    """

    def refused(reason: str) -> MairaError:
        return error(f"{name} must be {wanted or _numbers_of(shape)}{reason}")

    if _claimed_size(value) > LARGEST_SIZE:  # nested aliases of one list can mean terabytes
        raise error(f"{name} holds more than {LARGEST_SIZE} numbers: {shown(value)}")
    try:
        raw = np.asarray(value)
        masked = np.ma.is_masked(value) or (isinstance(value, (list, tuple)) and any(map(np.ma.is_masked, value)))
    except ValueError:
        raise refused(f", not entries of different lengths: {shown(value)}") from None
    except Exception as reason:  # whatever a class of the caller's own raises
        raise refused(f", not {shown(value)}: {reason!s:.300}") from None
    is_plain = raw.dtype.kind == "O" and raw.size > 0 and all(type(each) in (int, float) for each in raw.flat)
    if raw.dtype.kind not in "iuf" and not is_plain:
        raise refused(f", not {_kind(value, raw)}: {shown(value)}")
    if masked:
        raise refused(" throughout: entries of it are masked")
    try:
        with np.errstate(over="ignore"):  # of what is longer than a double
            array = np.array(raw, dtype=np.float64, order="C")
    except OverflowError:
        raise refused(f", not beyond the largest float: {shown(value)}") from None
    if len(array.shape) != len(shape) or any(s not in (None, n) for s, n in zip(shape, array.shape, strict=True)):
        given = f"{type(value).__name__} of shape {array.shape}" if array.ndim else f"the one number {shown(value)}"
        raise refused(f", not {given}")
    if finite is not None and (np.isnan(array).any() or (finite and not np.isfinite(array).all())):
        entries = " ".join(np.array2string(array, threshold=20, precision=4).split())
        raise error(f"{name} must {'be finite' if finite else 'not be NaN'}, got {entries}")
    return array


def _numbers_of(shape: tuple[int | None, ...]) -> str:
    """Numbers of a shape (None: any length) in words."""
    if not shape:
        return "a real number"
    lengths = ", ".join("any" if length is None else str(length) for length in shape)
    return f"real numbers of shape ({lengths}{',' if len(shape) == 1 else ''})"


def _kind(value: Any, raw: np.ndarray) -> str:
    """Of what type a value is, and the first of its entries (as an array) that is no number."""
    if not raw.ndim:
        return type(value).__name__
    entries = (each for each in raw.flat if isinstance(each, (bool, np.bool_)) or not isinstance(each, numbers.Real))
    entry = type(next(entries, None)).__name__.rstrip("_") if raw.size else raw.dtype.type.__name__.rstrip("_")
    return f"{type(value).__name__} of {entry}"


SYMMETRIC_WITHIN = 1e-9
"""Of a matrix that counts as symmetric and positive semidefinite: rounding, as a share of its largest entry."""


def semidefinite_matrix(value: Any, n: int, name: str, error: type[MairaError]) -> np.ndarray:
    """A symmetric positive semidefinite matrix (n, n), not zero, from what a caller passed. Raises `error`."""
    M = real_array(value, (n, n), name, error)
    size = float(np.abs(M).max(initial=0.0))
    if not size > 0.0:
        raise error(f"{name} must not be zero throughout")
    gap = np.abs(M / size - M.T / size)
    if gap.max() > SYMMETRIC_WITHIN:
        i, j = (int(k) for k in np.unravel_index(gap.argmax(), gap.shape))
        raise error(f"{name} must be symmetric, but entry ({i}, {j}) is {M[i, j]:.6g} and ({j}, {i}) is {M[j, i]:.6g}")
    M = 0.5 * M + 0.5 * M.T
    least = float(np.linalg.eigvalsh(M / size)[0]) * size
    if least < -SYMMETRIC_WITHIN * n * size:
        raise error(f"{name} must be positive semidefinite, but its least eigenvalue is {least:.6g}")
    return M


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
