"""Numbers as text, and sentences with lengths and angles in them, which a reader can have in other units."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass


def fixed(value: float, decimals: int, sign: str = "") -> str:
    """A number with so many decimals, without a minus before zeros; `sign` "+": others have a plus."""
    return f"{round(value, decimals) + 0.0:{sign}.{decimals}f}"


def figures(value: float) -> str:
    """A number with three figures, or all before the point: 0.0123, 12.3, 12,300."""
    return f"{value:,.0f}" if 999.5 <= abs(value) < 1e9 else f"{value:.3g}"


@dataclass(frozen=True)
class SentenceUnits:
    """How lengths and angles are written; None: as each sentence writes them by itself."""

    length: Callable[[float], str] | None = None
    """Of metres"""
    angle: Callable[[float], str] | None = None
    """Of radians"""


@dataclass(frozen=True)
class Quantity:
    """A length, an angle, or a speed, in a sentence."""

    value: float
    unit: str
    """"m", "rad", "m/s" or "rad/s" """
    text: str
    """How the sentence writes it by itself"""

    def in_units(self, units: SentenceUnits) -> str:
        """As text."""
        base, slash, per = self.unit.partition("/")
        write = units.length if base == "m" else units.angle
        return self.text if write is None else f"{write(self.value)}{slash}{per}"


class Wording(str):
    """A text that knows the quantities in it."""

    parts: tuple[str | Quantity, ...]

    def __new__(cls, *parts: str | Quantity) -> Wording:
        """Of texts, other wordings, and quantities, one after the other."""
        text = super().__new__(cls, "".join(part.text if isinstance(part, Quantity) else part for part in parts))
        text.parts = tuple(each for part in parts for each in (part.parts if isinstance(part, Wording) else (part,)))
        return text


def joined(separator: str, parts: Iterable[str | Quantity]) -> Wording:
    """Texts and quantities, with a text between each two."""
    between = [each for part in parts for each in (separator, part)]
    return Wording(*between[1:])


def in_units(text: str, units: SentenceUnits) -> str:
    """A text with its quantities in units; one that knows of none as it is."""
    parts = text.parts if isinstance(text, Wording) else (text,)
    return "".join(part.in_units(units) if isinstance(part, Quantity) else part for part in parts)
