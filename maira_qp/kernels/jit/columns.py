"""Classes of integer constants that a kernel reads as those of a module: known when it is compiled, at no cost."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numba import types
from numba.extending import typeof_impl


class _Constant(type):
    """The type of classes whose attributes do not change."""


class Columns(metaclass=_Constant):
    """A group of constants, in kernels and in Python: `class Joint(Columns): LOWER = 13`, then `chain[i, Joint.LOWER]`.

    Numba takes no classes, and members of an `IntEnum` for a type of their own; a module's numbers are just numbers.
    """

    WIDTH: ClassVar[int]
    """How long a row is, where that does not depend on the problem"""

    @classmethod
    def row(cls, **values: float) -> np.ndarray:
        """A row (WIDTH,) from the values of its columns by their names; a column that is not given is NaN."""
        row = np.full(cls.WIDTH, np.nan)
        for name, value in values.items():
            row[getattr(cls, name)] = value
        return row


@typeof_impl.register(_Constant)
def _as_module(group: Any, _: Any) -> types.Module:
    return types.Module(group)
