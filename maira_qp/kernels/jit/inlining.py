"""Kernels as parts of others: LLVM sees them once for each kernel that is called from Python, and not at every level.

By itself Numba optimises and translates every function as soon as it knows its types, and all over again what the
function calls, with everything that these call in turn: of kernels nested ten deep, ten times. A part is left as it was
lowered, and taken in as such by its callers; none of its code runs by itself, so nothing else is made of it.
"""

from __future__ import annotations

import gc
import operator
import os
from abc import abstractmethod
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any, ClassVar

from llvmlite.binding import Linkage
from numba import njit, types
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder, Flags
from numba.core.compiler_machinery import LoweringPass, register_pass
from numba.core.cpu import CPUContext
from numba.core.datamodel.models import OpaqueModel
from numba.core.typed_passes import InlineOverloads, IRLegalization, NopythonRewrites
from numba.core.untyped_passes import DeadBranchPrune, InlineClosureLikes, WithLifting
from numba.extending import register_model

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
    """Numba's compiler of functions without Python objects, that looks up what it has found out before."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        state = self.state
        state.flags = _Flags(state.flags)
        # the target's context is a copy of its own for each function, so nobody else's functions see this
        state.typingctx = state.targetctx.typing_context = _Typing(state.typingctx)
        state.targetctx.get_abi_sizeof = partial(_size, state.targetctx)

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
        """Numba's passes without those for what no kernel has: closures, comprehensions, whole arrays."""
        pipeline = DefaultPassBuilder.define_nopython_pipeline(self.state)
        pipeline.passes = [(found, text) for found, text in pipeline.passes if found not in _NOT_NEEDED]
        pipeline._finalized = False
        pipeline.add_pass_after(self._open_library, IRLegalization)
        pipeline.finalize()
        return [pipeline]

    @property
    def _open_library(self) -> type[LoweringPass]:
        """The pass that opens the library that the kernel is lowered into."""
        return _OpenEntry


class _PartCompiler(EntryCompiler):
    """The same with libraries of another kind."""

    @property
    def _open_library(self) -> type[LoweringPass]:
        return _OpenPart


_NOT_NEEDED = (WithLifting, InlineClosureLikes, DeadBranchPrune, InlineOverloads, NopythonRewrites)


class _Typing:
    """Numba's knowledge of types, which of a function between types asks but once what it gives.

    By itself it tries all that NumPy knows of an operator each time it meets one: a fifth of all its time.
    """

    def __init__(self, context: Any) -> None:
        self._context = context

    def __getattr__(self, name: str) -> Any:
        return getattr(self._context, name)

    def resolve_value_type(self, value: Any) -> Any:
        """The type of a value; of a function that Numba knows, one that remembers."""
        found = self._context.resolve_value_type(value)
        return _Function.of(found) if type(found) is types.Function else found

    def resolve_function_type(self, func: Any, args: Any, kws: Any) -> Any:
        """The signature of a function for arguments of these types."""
        if isinstance(func, _Function) and not kws:
            return func.get_call_type(self._context, args, kws)
        return self._context.resolve_function_type(func, args, kws)

    def resolve_getitem(self, value: Any, index: Any) -> Any:
        """The signature of an element of a value."""
        return self.resolve_value_type(operator.getitem).get_call_type(self._context, (value, index), {})

    def resolve_setitem(self, target: Any, index: Any, value: Any) -> Any:
        """The signature of the assignment to an element."""
        return self.resolve_value_type(operator.setitem).get_call_type(self._context, (target, index, value), {})


class _Function(types.Function):
    """A function that Numba knows, and its signatures so far."""

    _known: ClassVar[dict[types.Function, _Function]] = {}

    @classmethod
    def of(cls, function: types.Function) -> _Function:
        """The one for a function of Numba's."""
        if function not in cls._known:
            cls._known[function] = cls(function.templates)
        return cls._known[function]

    def __init__(self, template: Any) -> None:
        super().__init__(template)
        self._signatures: dict[Any, Any] = {}

    def get_call_type(self, context: Any, args: Any, kws: Any) -> Any:
        """The signature for arguments of these types. Raises `TypingError`."""
        if kws:
            return super().get_call_type(context, args, kws)
        args = tuple(args)
        if args not in self._signatures:
            self._signatures[args] = super().get_call_type(context, args, kws)
        return self._signatures[args]


register_model(_Function)(OpaqueModel)


def _size(context: Any, type_: Any) -> int:
    """The bytes of a value of LLVM's type, for which Numba each time makes and reads a module."""
    name = str(type_)
    if name not in _SIZES:
        _SIZES[name] = CPUContext.get_abi_sizeof(context, type_)
    return _SIZES[name]


_SIZES: dict[str, int] = {}


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


class _OpenLibrary(LoweringPass):
    """Open the library that the kernel is lowered into."""

    def __init__(self) -> None:
        LoweringPass.__init__(self)

    def run_pass(self, state: Any) -> bool:  # type: ignore[override]
        state.library = self.library(state)
        return False

    @abstractmethod
    def library(self, state: Any) -> JITCodeLibrary:
        """The library for what is compiled."""


@register_pass(mutates_CFG=False, analysis_only=False)
class _OpenPart(_OpenLibrary):
    _name = "open_library_of_part"

    def library(self, state: Any) -> JITCodeLibrary:
        return _Part(state.targetctx.codegen(), state.func_id.func_qualname)


@register_pass(mutates_CFG=False, analysis_only=False)
class _OpenEntry(_OpenLibrary):
    _name = "open_library_of_entry"

    def library(self, state: Any) -> JITCodeLibrary:
        library = _Entry(state.targetctx.codegen(), state.func_id.func_qualname)
        library.enable_object_caching()
        return library


class _Library(JITCodeLibrary):
    """Code that is optimised where all of it is together, and no function by itself."""

    def _optimize_functions(self, ll_module: Any) -> None:
        ll_module.data_layout = self._codegen._data_layout


class _Part(_Library):
    """Code that is linked into the libraries of entries, and loaded as part of these alone."""

    def finalize(self) -> None:
        """Only make it fit to be linked, together with the parts that it calls, by each entry."""
        for function in self._final_module.functions:
            if not function.is_declaration and function.linkage == Linkage.external:
                function.linkage = "linkonce_odr"
        self._finalized = True

    def _get_module_for_linking(self) -> Any:
        """The code with all that it calls, which functions that are no kernels take in as they do any other."""
        if self._shared_module is None:
            self._shared_module = self._final_module.clone()
            _link(self, self._shared_module)
        return self._shared_module

    @property
    def codegen(self) -> Any:
        return _NotLoaded()


class _Entry(_Library):
    """Code that is called from Python, with that of all its parts."""

    def finalize(self) -> None:
        """Link all parts, then compile."""
        _link(self, self._final_module)
        self._linking_libraries = []
        super().finalize()

    def _optimize_final_module(self) -> None:
        """Numba's passes but those that make vectors of loops: they take a tenth of the time, and make nothing faster.

        Kernels that are to work on vectors say so (`kernels.jit.simd`), and the loops of the others are short.
        """
        for passes in ({"opt": self._codegen._opt_level, "cost": "cheap"}, {}):
            manager, builder = self._codegen._module_pass_manager(loop_vectorize=False, slp_vectorize=False, **passes)
            manager.run(self._final_module, builder)


def _link(library: Any, module: Any) -> None:
    """Link what a library and its parts call into a module, callers first: LLVM takes in only what is called."""
    for other in _callers_first(library._linking_libraries):
        library._reload_init.update(other._reload_init)
        open_or_whole = other._final_module if isinstance(other, _Part) else other._get_module_for_linking()
        module.link_in(open_or_whole, preserve=True)


def _callers_first(libraries: Iterable[Any]) -> list[Any]:
    """Libraries with those that their parts link, in an order in which each comes before those it links."""
    found: dict[Any, None] = {}

    def visit(library: Any) -> None:
        if library not in found:
            if isinstance(library, _Part):
                for other in library._linking_libraries:
                    visit(other)
            found[library] = None

    for library in libraries:
        visit(library)
    return list(reversed(found))


class _NotLoaded:
    """In place of the engine that would hold the code."""

    def set_env(self, name: str, environment: Any) -> None:
        """Code that does not run has no environment."""
