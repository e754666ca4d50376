"""Values of joints by name, as arrays in the order of a robot's joints."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from maira_qp.arrays import is_listing, real_array
from maira_qp.errors import ConfigurationError, MairaError, OptionError, hint, joined, listed, shown


def check_joints(names: Iterable[Any], known: Sequence[str], what: str, error: type[MairaError]) -> None:
    """Raises `error`, with a word for what holds the names, for one that is not among the known ones."""
    for name in names:
        if name not in known:
            raise error(f"{what}: {shown(name)} is not a joint that moves on its own; {listed(known, name)}")


def joint_array(
    values: Any,
    joint_names: tuple[str, ...],
    name: str,
    error: type[MairaError] = ConfigurationError,
    default: np.ndarray | None = None,
    finite: bool = True,
) -> np.ndarray:
    """A fresh array (n,) from an array (n,) or a mapping {joint name: value}.

    Joints that a mapping does not name keep the value that they have in `default` (n,). Raises `error`, with the name
    of the argument, where there is no default, for a name that no joint has, and for what is no number, finite unless
    `finite` is False.
    """
    n = len(joint_names)
    if not isinstance(values, Mapping):
        return real_array(values, (n,), name, error, finite=finite)
    check_joints(values, joint_names, name, error)
    if default is None and len(values) < n:
        missing = ", ".join(repr(each) for each in joint_names if each not in values)
        raise error(f"{name} needs a value for each joint, and {missing} is missing")
    array = np.empty(n) if default is None else np.array(default, dtype=np.float64)
    named = [i for i, joint in enumerate(joint_names) if joint in values]
    given = [values[joint_names[i]] for i in named]
    try:
        array[named] = real_array(given, (len(named),), name, error, finite=finite)
    except error:  # which one is it?
        for i, value in zip(named, given, strict=True):
            array[i] = real_array(value, (), f"{name} of joint {joint_names[i]!r}", error, finite=finite)
    return array


def joint_values(
    joint_names: tuple[str, ...], values: Any, name: str, default: np.ndarray, finite: bool = False
) -> np.ndarray:
    """An array (n,) from a number for all joints, from one each, or from {joint name: value}, infinities among it.

    Joints that are not named have the default (n,). Raises `OptionError` with the name of the argument.
    """
    if np.isscalar(values) or (isinstance(values, np.ndarray) and not values.ndim):
        return np.broadcast_to(real_array(values, (), name, OptionError, finite=finite), default.shape)
    return joint_array(values, joint_names, name, OptionError, default, finite)


def joint_order(names: Any, joint_names: tuple[str, ...]) -> np.ndarray:
    """Where each of the robot's joints is among names: indices (n,). Raises `OptionError`; see `Robot.order`."""
    if not is_listing(names):
        raise OptionError(f"names must be a list of names of joints, got {shown(names)}")
    places: dict[Any, int] = {}
    for k, name in enumerate(names):
        if isinstance(name, str) and places.setdefault(name, k) != k and name in joint_names:
            raise OptionError(f"names: the joint {name!r} is named twice")
    missing = [name for name in joint_names if name not in places]
    if missing:
        given = list(places)
        meant = hint([name for name in given if name not in joint_names], missing[0])
        lacking = ", ".join(map(repr, missing))
        raise OptionError(f"the names lack {lacking}; {meant}given: {joined(given) or 'none'}")
    return np.array([places[name] for name in joint_names], dtype=np.intp)
