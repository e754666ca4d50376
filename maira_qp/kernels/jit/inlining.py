"""Kernels as parts of others: LLVM sees them once for each kernel that is called from Python, and not at every level.

By itself Numba optimises and translates every function as soon as it knows its types, and all over again what the
function calls, with everything that these call in turn: of kernels nested ten deep, ten times. A part is left as it was
lowered, and taken in as such by its callers; none of its code runs by itself, so nothing else is made of it.
"""

from __future__ import annotations

import gc
import os
from collections.abc import Callable
from typing import Any, ClassVar

from numba import njit, types
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder, Flags
from numba.core.compiler_machinery import LoweringPass, register_pass
from numba.core.typed_passes import InlineOverloads, IRLegalization, NopythonRewrites
from numba.core.untyped_passes import DeadBranchPrune, InlineClosureLikes, WithLifting

INLINE = os.environ.get("MAIRA_QP_INLINE", "1") != "0"
"""Whether all this is used. Without (`MAIRA_QP_INLINE=0`) Numba compiles kernels as any other function, which takes
longer: for a version of Numba whose inside has changed, and to find out whose fault something is."""


def part(function: Callable, options: dict[str, Any]) -> Any:
    """A function for others to call, with options of `numba.njit`: compiled once for arguments of a type, not a value.

    Numba takes a constant for a type of its own.
    """
    dispatcher: Any = njit(**options | {"pipeline_class": _PartCompiler, "no_cpython_wrapper": True})(function)
    find = dispatcher.get_call_template
    dispatcher.get_call_template = lambda args, kws: find(tuple(map(types.unliteral, args)), kws)
    return dispatcher


class EntryCompiler(CompilerBase):
    """Numba's compiler of functions without Python objects, with options that are known by what they are."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.state.flags = _Flags(self.state.flags)
        self.state.typingctx = _Operators(self.state.typingctx)

    def compile_extra(self, func: Any) -> Any:
        """Compile, without looking for garbage among what is nearly all still in use: a tenth of the time."""
        collects = gc.isenabled()
        gc.disable()
        try:
            return super().compile_extra(func)
        finally:
            if collects:
                gc.enable()

    def define_pipelines(self) -> list[Any]:
        """The passes of a function that Python calls."""
        return [_needed(DefaultPassBuilder.define_nopython_pipeline(self.state))]


class _PartCompiler(EntryCompiler):
    """The same with libraries of another kind."""

    def define_pipelines(self) -> list[Any]:
        """The passes of a part."""
        pipeline = _needed(DefaultPassBuilder.define_nopython_pipeline(self.state))
        pipeline.add_pass_after(_OpenLibrary, IRLegalization)
        pipeline.finalize()
        return [pipeline]


def _needed(pipeline: Any) -> Any:
    """Numba's passes without those for what no kernel has: closures, comprehensions, expressions of whole arrays."""
    pipeline.passes = [(found, text) for found, text in pipeline.passes if found not in _NOT_NEEDED]
    pipeline._finalized = False
    pipeline.finalize()
    return pipeline


_NOT_NEEDED = (WithLifting, InlineClosureLikes, DeadBranchPrune, InlineOverloads, NopythonRewrites)


class _Operators:
    """Numba's knowledge of types, which of an operator between numbers or arrays asks but once what it gives.

    By itself it tries each time all that NumPy knows of such an operator: a fifth of all its time.
    """

    _known: ClassVar[dict[Any, Any]] = {}

    def __init__(self, context: Any) -> None:
        self._context = context

    def __getattr__(self, name: str) -> Any:
        return getattr(self._context, name)

    def resolve_function_type(self, func: Any, args: Any, kws: Any) -> Any:
        """The signature of a function for arguments of these types."""
        is_plain = isinstance(func, types.Function) and not kws and all(isinstance(arg, _PLAIN) for arg in args)
        if not is_plain:
            return self._context.resolve_function_type(func, args, kws)
        asked = func, tuple(args)
        if asked not in self._known:
            self._known[asked] = self._context.resolve_function_type(func, args, kws)
        return self._known[asked]


_PLAIN = (types.Number, types.Boolean, types.Array, types.BaseTuple)


class _Flags(Flags):
    """Options of a function, of which Numba takes a copy when it begins to compile it: one for all with the same."""

    _known: ClassVar[dict[str, _SettledFlags]] = {}

    def copy(self) -> _SettledFlags:
        """The copy, which does not change."""
        return self._known.setdefault(self.summary(), _SettledFlags(self))


class _SettledFlags(Flags):
    """Options by which Numba looks up what it knows, thousands of times a kernel: a tenth of all its time."""

    __hash__ = object.__hash__

    def copy(self) -> Flags:
        """One that may change."""
        return Flags(self)


@register_pass(mutates_CFG=False, analysis_only=False)
class _OpenLibrary(LoweringPass):
    """Open the library that the kernel is lowered into."""

    _name = "open_library_of_part"

    def __init__(self) -> None:
        LoweringPass.__init__(self)

    def run_pass(self, state: Any) -> bool:  # type: ignore[override]
        state.library = _Library(state.targetctx.codegen(), state.func_id.func_qualname)
        return False


class _Library(JITCodeLibrary):
    """Code that is linked into other libraries, and loaded as part of these alone: optimised there, not here."""

    def _optimize_functions(self, ll_module: Any) -> None:
        pass

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True

    @property
    def codegen(self) -> Any:
        return _NotLoaded()


class _NotLoaded:
    """In place of the engine that would hold the code."""

    def set_env(self, name: str, environment: Any) -> None:
        """Code that does not run has no environment."""
