"""Names by which a call speaks of the parts of a problem: its tasks, its objectives, its limits.

A part's key is the name that it was given, else the frame that it is about, else a word for its class: "posture",
"swivel". The parts of a problem share four things: a `key`, `with_value(value)` for another datum (its target,
point, angle, reference ...), `scaled(factor)` for another weight, and `is_off`, which says that it counts nothing. A
datum that stands in the base says so by `datum`: it is a pose, a point or a direction; of others `datum` is empty.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

from maira_qp.arrays import is_number
from maira_qp.errors import FrameError, OptionError, shown

NO_DATUM = "takes no value from a call"

POSE, POINT, DIRECTION = "pose", "point", "direction"
"""What `datum` is of what stands in the base. A pose is a pose for all three."""


@dataclass(frozen=True)
class Off:
    """A part that is switched off: it stays known by its key, and counts nothing."""

    part: Any
    is_off = True
    datum = ""

    @property
    def name(self) -> str | None:
        """That of the part."""
        return self.part.name  # type: ignore[no-any-return]

    @property
    def key(self) -> str:
        """That of the part."""
        return self.part.key  # type: ignore[no-any-return]

    @property
    def target_key(self) -> str | None:
        """That of the part."""
        return self.part.target_key  # type: ignore[no-any-return]

    def with_value(self, value: Any) -> Off:
        """The same: whatever its datum is, it counts nothing."""
        return self

    def scaled(self, factor: float) -> Off:
        """The same."""
        return self


def word_for(part: object) -> str:
    """The word for a part's class: "swivel" for a `SwivelTask`, "limit_distance" for `LimitDistance`."""
    return _word_of(type(part).__name__)


@cache
def _word_of(kind: str) -> str:
    name = kind.removesuffix("Task").lstrip("_") or kind
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name).lower()


def check_name(name: object, owner: object) -> None:
    """Raises `OptionError` for a name that is none."""
    if name is not None and not (isinstance(name, str) and name.strip()):
        raise OptionError(f"the name of a {type(owner).__name__} must be text that is not empty, got {shown(name)}")


def checked_factor(key: str, factor: object) -> float:
    """A factor for a weight. Raises `OptionError`."""
    if not (is_number(factor) and 0 <= factor < float("inf")):  # type: ignore[operator]
        raise OptionError(f"the weight of {key!r} is multiplied by a number >= 0, got {shown(factor)}")
    return float(factor)  # type: ignore[arg-type]


def places_by_key(parts: Sequence[Any]) -> dict[str, tuple[int, ...]]:
    """Where the parts are that a key speaks of.

    Tasks of one frame without names that take their target from the call share it. Of other parts without names, those
    whose key another part has too cannot be spoken of. Raises `OptionError` for a name that is given twice.
    """
    places: dict[str, tuple[int, ...]] = {}
    for i, part in enumerate(parts):
        if (name := part.name) is not None:
            if name in places:
                first = _class_of(parts[places[name][0]])
                raise OptionError(f"the name {name!r} is given twice, to a {first} and to a {_class_of(part)}")
            places[name] = (i,)
    named = frozenset(places)
    for i, part in enumerate(parts):
        if part.name is None and getattr(part, "target_key", None) is not None:
            if part.key in named:
                raise OptionError(
                    f"the name {part.key!r} is given to a {_class_of(parts[places[part.key][0]])}, and a "
                    f"{_class_of(part)} takes its target by the name of that frame; name it too"
                )
            places[part.key] = (*places.get(part.key, ()), i)
    alone = Counter(part.key for part in parts if part.name is None)
    for i, part in enumerate(parts):
        if part.name is None and part.key not in places and alone[part.key] == 1:
            places[part.key] = (i,)
    return dict(sorted(places.items(), key=lambda place: place[1]))


def check_known(keys: Iterable[Any], known: Iterable[str]) -> None:
    """Raises `FrameError` for a key that is none."""
    known = tuple(known)
    for key in keys:
        if key not in known:
            there = ", ".join(map(repr, known)) or "none that has a name"
            raise FrameError(f"no task {shown(key)}; there are {there}")


def changed(
    parts: Sequence[Any], places: Mapping[str, tuple[int, ...]], values: Mapping[str, Any], factors: Mapping[str, Any]
) -> tuple[Any, ...]:
    """The parts with other data and with weights times factors. Raises what the parts raise."""
    made = list(parts)
    for key, value in values.items():
        for i in places[key]:
            made[i] = made[i].with_value(value)
    for key, value in factors.items():
        factor = checked_factor(key, value)
        for i in places[key]:
            made[i] = made[i].scaled(factor) if factor > 0 else Off(made[i])
    return tuple(made)


def are_same(some: Sequence[Any], others: Sequence[Any]) -> bool:
    """Whether parts are the very same, one by one."""
    return all(one is other for one, other in zip(some, others, strict=True))


def _class_of(part: object) -> str:
    return type(part).__name__
