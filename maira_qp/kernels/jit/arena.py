"""Scratch memory of kernels, declared: the arrays that one works in, each by its name and its shape, in one place.

    TICK = Arena("TickWork", "n tasks", floats={"H": "n, n", "tools": "tasks, 3, 12"}, integers={"side": "n"})

says that a kernel works in float64 arrays H (n, n) and tools (tasks, 3, 12) and in an array side (n,) of int64. They
lie one after another in two memories, which whoever calls the kernel makes: that costs less than to make each. How long
the memories are, and the kernel that cuts the arrays out of them, follow from the declaration.

The memory of an arena may be a part of another's: its lengths, `floats` and `integers`, are shapes as others are.
"""

from __future__ import annotations

import ast
import sys
from collections import namedtuple
from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Any

import numpy as np
from numba import config, types
from numba.core import cgutils
from numba.core.imputils import impl_ret_borrowed
from numba.extending import intrinsic
from numba.np.arrayobj import make_array, populate_array

from maira_qp.kernels.jit.decorators import device_kernel
from maira_qp.kernels.jit.simd import LANES


class Arena:
    """Named arrays in two memories, whose lengths depend on some `dimensions`, names with spaces between them.

    `floats` and `integers` tell the shape of each array: Python expressions of the dimensions with commas between them.
    With `lanes` the arrays of float64 have a last axis more, `LANES` long, and begin on lines of the cache.
    """

    Arrays: Any
    """The named tuple of the arrays. It has to stand in the arena's module by its name, for code is kept that knows it.

    A kernel takes what it needs into local names first: it is slow to ask for a field in a loop.
    """
    floats: str
    integers: str
    """How long the memories are, expressions of the dimensions."""
    sizes: Callable[..., tuple[int, int]]
    """How long the memories are for given dimensions."""
    carve: Any
    """The kernel that gives the arrays for the dimensions, then memory of float64 and of int64: those that there are.

    It counts no references, so a kernel that makes arrays must not call it.
    """
    plain: Callable[..., Any]
    """The same in Python, where a memory that is too short is an error."""
    make: Any
    """The kernel that gives the arrays for the dimensions in memory of its own, of zeros."""

    def __init__(
        self,
        name: str,
        dimensions: str = "",
        *,
        floats: Mapping[str, str] | None = None,
        integers: Mapping[str, str] | None = None,
        lanes: bool = False,
    ) -> None:
        self.dimensions, self.lanes = dimensions.split(), lanes
        names, module = self.dimensions, sys._getframe(1).f_globals["__name__"]
        shapes = {
            "floats": {key: _parts(shape) + [str(LANES)] * lanes for key, shape in (floats or {}).items()},
            "integers": {key: _parts(shape) for key, shape in (integers or {}).items()},
        }
        begins = {"floats": f"-floats.ctypes.data // 8 % {LANES}" if lanes else "0", "integers": "0"}
        memories = [memory for memory, arrays in shapes.items() if arrays]
        lines, views = [], []
        for memory in memories:
            lines.append(f"{memory}_0 = {begins[memory]}")
            for k, parts in enumerate(shapes[memory].values()):
                lines.append(f"{memory}_{k + 1} = {memory}_{k} + {' * '.join(parts)}")
                views.append(f"view({memory}, {memory}_{k}, ({', '.join(parts)},))")
        self.floats = _total(shapes["floats"], LANES - 1 if lanes else 0)
        self.integers = _total(shapes["integers"])
        self.Arrays = namedtuple(name, [*shapes["floats"], *shapes["integers"]], module=module)
        known = {"__name__": module, "view": view, "zeros": np.zeros, "int64": np.int64, "Arrays": self.Arrays}
        carving = "_carve", [*names, *memories], lines, f"Arrays({', '.join(views)})"
        carve, self.plain = _function(*carving, known), _function(*carving, {**known, "view": _plain_view})
        self.sizes = lru_cache(_function("_sizes", names, [], f"{self.floats}, {self.integers}", known))
        self.carve, known["carve"] = device_kernel(carve), device_kernel(carve, allocates=True)
        zeros = {"floats": f"zeros({self.floats})", "integers": f"zeros({self.integers}, int64)"}
        made = ", ".join([*names, *(zeros[memory] for memory in memories)])
        self.make = device_kernel(_function("_make", names, [], f"carve({made})", known), allocates=True)

    def empty(self, *dimensions: int) -> tuple[np.ndarray, ...]:
        """The memories for given dimensions, of float64 and of int64: those that there are."""
        floats, integers = self.sizes(*dimensions)
        if not integers:
            return (np.empty(floats),)
        return np.empty(floats), np.empty(integers, np.int64)


def _parts(shape: str) -> list[str]:
    """The expressions that a shape is made of."""
    tree: Any = ast.parse(f"({shape},)", mode="eval")
    return [f"({ast.unparse(part)})" for part in tree.body.elts]


def _total(shapes: Mapping[str, list[str]], more: int = 0) -> str:
    """How many numbers arrays of some shapes have together, and some more."""
    return " + ".join([*(" * ".join(parts) for parts in shapes.values()), str(more)])


def _function(name: str, parameters: list[str], lines: list[str], result: str, known: dict[str, Any]) -> Callable:
    """Define a function, which knows some names, by its source."""
    body = "".join(f"    {line}\n" for line in [*lines, f"return {result}"])
    exec(f"def {name}({', '.join(parameters)}):\n{body}", known)
    return known[name]


def _viewing(typingctx, memory, at, shape):
    view_type = types.Array(memory.dtype, len(shape), "C")

    def emit(context, builder, sig, args):
        source, made = make_array(memory)(context, builder, args[0]), make_array(view_type)(context, builder)
        lengths, strides = cgutils.unpack_tuple(builder, args[2]), [source.itemsize]
        for length in reversed(lengths[1:]):
            strides.insert(0, builder.mul(strides[0], length))
        populate_array(
            made,
            data=builder.gep(source.data, [args[1]]),
            shape=lengths,
            strides=strides,
            itemsize=source.itemsize,
            meminfo=source.meminfo,
            parent=source.parent,
        )
        return impl_ret_borrowed(context, builder, view_type, made._getvalue())

    return view_type(memory, types.intp, types.UniTuple(types.intp, len(shape))), emit


def _plain_view(memory, at, shape):
    return memory.reshape(-1)[at : at + np.prod(shape, dtype=int)].reshape(shape)


view: Any = _plain_view if config.DISABLE_JIT else intrinsic(_viewing)
"""The numbers of a contiguous array from entry `at` on, rows after rows, as an array of a shape."""
