"""Eight numbers side by side: a value that one SIMD instruction works on, so that eight problems run as one.

A *lane* is one of the eight problems. Where an array has one axis more than a kernel indexes, and that axis is `LANES`
long, `load` gives all eight entries as one value with the operators of a float: an arithmetic one acts in every lane, a
comparison gives a mask, `select` chooses by it. Where the array has no such axis the same functions work on one float.
So a kernel that is written with them is compiled twice, for one problem and for eight, from one source.

What happens in a lane depends on that lane alone, to the bit. Without Numba's compiler (NUMBA_DISABLE_JIT=1) eight
numbers are a NumPy array, and all of this is plain Python.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba import config, types
from numba.core import cgutils
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, models, register_model

LANES = 8

_VALUES = ir.VectorType(ir.DoubleType(), LANES)
_MASK = ir.VectorType(ir.IntType(1), LANES)
_CONTRACT = ("contract",)


class _Lanes(types.Type):
    """The type of eight floats, or of eight booleans."""

    def __init__(self, content: str) -> None:
        super().__init__(name=f"lanes({LANES} x {content})")
        self.content = content


values, mask = _Lanes("float64"), _Lanes("bool")


@register_model(_Lanes)
class _Model(models.PrimitiveModel):
    def __init__(self, dmm: Any, fe_type: _Lanes) -> None:
        super().__init__(dmm, fe_type, _VALUES if fe_type == values else _MASK)


def _compiled_by(typing: Callable) -> Callable:
    """The decorated function where Numba's compiler is off, else what `typing` emits in its place."""
    return lambda plain: plain if config.DISABLE_JIT else intrinsic(typing)


def _splat(builder: ir.IRBuilder, number: ir.Value) -> ir.Value:
    one = builder.insert_element(ir.Constant(_VALUES, ir.Undefined), number, ir.Constant(ir.IntType(32), 0))
    first = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
    return builder.shuffle_vector(one, ir.Constant(_VALUES, ir.Undefined), first)


def _in_lanes(context: Any, builder: ir.IRBuilder, value: ir.Value, kind: types.Type) -> ir.Value:
    return value if kind == values else _splat(builder, context.cast(builder, value, kind, types.float64))


def _arithmetic(kind: types.Type) -> bool:
    return kind == values or isinstance(kind, (types.Float, types.Integer))


def _operator(symbol: Callable, result: types.Type, emit: Callable) -> None:
    """An operator of two values of which at least one has lanes; the other may be a number."""

    @infer_global(symbol)  # type: ignore[misc]
    class _Typing(AbstractTemplate):
        def generic(self, args: tuple, kws: dict) -> Any:
            if len(args) == 2 and values in args and all(map(_arithmetic, args)):
                return signature(result, *args)
            return None

    def lower(context: Any, builder: ir.IRBuilder, sig: Any, args: tuple) -> ir.Value:
        return emit(builder, *(_in_lanes(context, builder, a, kind) for a, kind in zip(args, sig.args, strict=True)))

    for kinds in ((values, values), (values, types.Number), (types.Number, values)):
        lower_builtin(symbol, *kinds)(lower)


def _mask_operator(symbol: Callable, count: int, emit: Callable) -> None:
    @infer_global(symbol)  # type: ignore[misc]
    class _Typing(AbstractTemplate):
        def generic(self, args: tuple, kws: dict) -> Any:
            return signature(mask, *args) if args == (mask,) * count else None

    lower_builtin(symbol, *[mask] * count)(lambda context, builder, sig, args: emit(builder, *args))


_operator(operator.add, values, lambda builder, a, b: builder.fadd(a, b, flags=_CONTRACT))
_operator(operator.sub, values, lambda builder, a, b: builder.fsub(a, b, flags=_CONTRACT))
_operator(operator.mul, values, lambda builder, a, b: builder.fmul(a, b, flags=_CONTRACT))
_operator(operator.truediv, values, lambda builder, a, b: builder.fdiv(a, b))
_operator(operator.lt, mask, lambda builder, a, b: builder.fcmp_ordered("<", a, b))
_operator(operator.le, mask, lambda builder, a, b: builder.fcmp_ordered("<=", a, b))
_operator(operator.gt, mask, lambda builder, a, b: builder.fcmp_ordered(">", a, b))
_operator(operator.ge, mask, lambda builder, a, b: builder.fcmp_ordered(">=", a, b))
_operator(operator.eq, mask, lambda builder, a, b: builder.fcmp_ordered("==", a, b))
_operator(operator.ne, mask, lambda builder, a, b: builder.fcmp_unordered("!=", a, b))
_mask_operator(operator.and_, 2, lambda builder, a, b: builder.and_(a, b))
_mask_operator(operator.or_, 2, lambda builder, a, b: builder.or_(a, b))
_mask_operator(operator.invert, 1, lambda builder, a: builder.not_(a))


@infer_global(operator.neg)  # type: ignore[misc]
class _Negation(AbstractTemplate):
    def generic(self, args: tuple, kws: dict) -> Any:
        return signature(values, values) if args == (values,) else None


lower_builtin(operator.neg, values)(lambda context, builder, sig, args: builder.fneg(args[0]))


def _has_lanes(a: types.Type, indices: int) -> bool:
    return isinstance(a, types.Array) and a.ndim == indices + 1


def _place(context: Any, builder: ir.IRBuilder, kind: types.Array, array: ir.Value, index: tuple) -> Any:
    """A pointer to entry `index` of a C-contiguous array, or to the eight of its last axis."""
    view = context.make_array(kind)(context, builder, array)
    shape = cgutils.unpack_tuple(builder, view.shape)
    place = index[0]
    for length, i in zip(shape[1:], index[1:], strict=False):
        place = builder.add(builder.mul(place, length), i)
    if not _has_lanes(kind, len(index)):
        return builder.gep(view.data, [place])
    return builder.bitcast(
        builder.gep(view.data, [builder.mul(place, ir.Constant(ir.IntType(64), LANES))]), _VALUES.as_pointer()
    )


def _loading(typingctx, a, *index):
    def emit(context, builder, sig, args):
        return builder.load(_place(context, builder, sig.args[0], args[0], args[1:]), align=8)

    return (values if _has_lanes(a, len(index)) else types.float64)(a, *[types.intp] * len(index)), emit


def _storing(typingctx, a, *rest):
    def emit(context, builder, sig, args):
        place = _place(context, builder, sig.args[0], args[0], args[1:-1])
        kind = sig.args[-1]
        if _has_lanes(a, len(rest) - 1):
            value = _in_lanes(context, builder, args[-1], kind)
        else:
            value = context.cast(builder, args[-1], kind, types.float64)
        builder.store(value, place, align=8)
        return context.get_dummy_value()

    return types.void(a, *[types.intp] * (len(rest) - 1), rest[-1]), emit


def _filling(typingctx, a, value):
    def emit(context, builder, sig, args):
        number = context.cast(builder, args[1], sig.args[1], types.float64)
        return _splat(builder, number) if sig.return_type == values else number

    return (values if _has_lanes(a, 1) else types.float64)(a, value), emit


def _selecting(typingctx, chosen, a, b):
    def emit(context, builder, sig, args):
        if sig.return_type == values:
            a, b = (_in_lanes(context, builder, v, kind) for v, kind in zip(args[1:], sig.args[1:], strict=True))
        else:
            a, b = (context.cast(builder, v, k, types.float64) for v, k in zip(args[1:], sig.args[1:], strict=True))
        return builder.select(args[0], a, b)

    return (values if chosen == mask else types.float64)(chosen, a, b), emit


def _asking(typingctx, chosen):
    def emit(context, builder, sig, args):
        if sig.args[0] == types.boolean:
            return args[0]
        bits = builder.bitcast(args[0], ir.IntType(LANES))
        return builder.icmp_unsigned("!=", bits, ir.Constant(ir.IntType(LANES), 0))

    return types.boolean(chosen), emit


def _choosing(relation: str) -> Callable:
    def typing(typingctx, a, b):
        def emit(context, builder, sig, args):
            if sig.return_type == values:
                a, b = (_in_lanes(context, builder, v, kind) for v, kind in zip(args, sig.args, strict=True))
            else:
                a, b = (context.cast(builder, v, k, types.float64) for v, k in zip(args, sig.args, strict=True))
            return builder.select(builder.fcmp_ordered(relation, a, b), a, b)

        return (values if values in (a, b) else types.float64)(a, b), emit

    return typing


def _calling(name: str) -> Callable:
    """A function of LLVM that acts on a float, or in every lane."""

    def typing(typingctx, x):
        def emit(context, builder, sig, args):
            lanes = sig.args[0] == values
            kind, suffix = (_VALUES, f"v{LANES}f64") if lanes else (ir.DoubleType(), "f64")
            function = cgutils.get_or_insert_function(
                builder.module, ir.FunctionType(kind, [kind]), f"llvm.{name}.{suffix}"
            )
            return builder.call(function, args)

        return x(x), emit

    return typing


def _load1(typingctx, a, i):
    return _loading(typingctx, a, i)


def _load2(typingctx, a, i, j):
    return _loading(typingctx, a, i, j)


def _store1(typingctx, a, i, value):
    return _storing(typingctx, a, i, value)


def _store2(typingctx, a, i, j, value):
    return _storing(typingctx, a, i, j, value)


@_compiled_by(_load1)
def load(a, i):
    """Entry i of an array: a float, or the eight of its last axis."""
    return a[i].copy()


@_compiled_by(_load2)
def load2(a, i, j):
    """Entry (i, j) of an array: a float, or the eight of its last axis."""
    return a[i, j].copy()


@_compiled_by(_store1)
def store(a, i, value):
    """Write entry i of an array."""
    a[i] = value


@_compiled_by(_store2)
def store2(a, i, j, value):
    """Write entry (i, j) of an array."""
    a[i, j] = value


@_compiled_by(_filling)
def broadcast(a, value):
    """A number in every lane, where `a`, an array indexed by one number, has lanes; else the number."""
    return np.full(LANES, value) if np.ndim(a) == 2 else value


@_compiled_by(_selecting)
def select(chosen, a, b):
    """a where the mask says so, else b."""
    return np.where(chosen, a, b) if np.ndim(chosen) else (a if chosen else b)


@_compiled_by(_asking)
def any_lane(chosen):
    """The mask is true somewhere."""
    return bool(np.any(chosen))


@_compiled_by(_choosing("<"))
def minimum(a, b):
    """The smaller of two; b where one is NaN."""
    return select(a < b, a, b)


@_compiled_by(_choosing(">"))
def maximum(a, b):
    """The larger of two; b where one is NaN."""
    return select(a > b, a, b)


@_compiled_by(_calling("sqrt"))
def square_root(x):
    """Square root."""
    return np.sqrt(x)


@_compiled_by(_calling("fabs"))
def magnitude(x):
    """Absolute value."""
    return abs(x)


@_compiled_by(_calling("floor"))
def floor(x):
    """The largest whole number that is not larger."""
    return np.floor(x)
