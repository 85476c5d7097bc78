"""How numba compiles kernels and routines: only the passes that they need, and machine code for kernels only.

numba optimises a function and emits machine code for it, then does so again in each function that calls it. Nobody
calls a routine but kernels: here it stays in LLVM's intermediate code, which is optimised and emitted once, as a part
of each kernel. The passes are those of numba's `DefaultPassBuilder` without the ones for closures, literals, loops over
tuples, array expressions and reports, which kernels do not use.
"""

from __future__ import annotations

from types import FunctionType
from typing import TYPE_CHECKING, Any, ClassVar

from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, Flags
from numba.core.compiler_machinery import PassManager, register_pass
from numba.core.typed_passes import (
    IRLegalization,
    NativeLowering,
    NoPythonBackend,
    NopythonTypeInference,
    PreLowerStripPhis,
)
from numba.core.types import Function
from numba.core.untyped_passes import FixupArgs, GenericRewrites, ReconstructSSA, TranslateByteCode

from taxelflow.runtime.lowering import KernelLower, is_builtin
from taxelflow.runtime.vectors import VectorLower

if TYPE_CHECKING:
    from collections.abc import Callable

_ROOM_ENTRIES = 2**17 + 1
"""Size of a frame, entries of 8 bytes: half of a chunk of 2 MB, of which calls have the other half."""


class _Interned(Flags):
    """Options of the function that is being compiled, of which equal ones are one object.

    numba looks up by them what it has compiled, tens of thousands of times. Its own hash is a constant, so that each
    look-up compares all options of all that is there.
    """

    __hash__ = object.__hash__

    def __eq__(self, other: object) -> bool:
        return self is other


class _Options(Flags):
    """Options of a function, which its passes may change; the copy that numba takes at the start is interned."""

    _interned: ClassVar[list[_Interned]] = []

    def copy(self) -> _Interned:
        """The interned options that are equal."""
        own = self.values()
        for known in self._interned:
            if known.values() == own:
                return known
        self._interned.append(_Interned(self))
        return self._interned[-1]


def _call(function: Callable[[Any], Any], argument: object) -> Any:
    return function(argument)


_with_room = FunctionType(_call.__code__.replace(co_stacksize=_ROOM_ENTRIES), {})
"""Calls a function. CPython keeps frames in chunks of 16 kB, and maps and unmaps one whenever a call at the edge of a
chunk begins and returns. A frame that is larger gets a chunk of a power of two, and calls within it what it leaves."""


@register_pass(mutates_CFG=True, analysis_only=False)
class KernelLowering(NativeLowering):
    """Lowering by `KernelLower`."""

    _name = "kernel_lowering"
    lowering_class = KernelLower


class _Types:
    """numba's typing context, which remembers how operators and functions of its own are typed."""

    _typed: ClassVar[dict[tuple[int, Any], tuple[Any, Any]]] = {}

    def __init__(self, context: Any) -> None:
        self._context = context

    def __getattr__(self, name: str) -> Any:
        return getattr(self._context, name)

    def resolve_function_type(self, func: Any, args: Any, kws: Any) -> Any:
        """The signature of a call. Functions that are compiled for their types are looked for each time."""
        key = id(func), args
        if not kws and key in self._typed:
            return self._typed[key][1]
        signature = self._context.resolve_function_type(func, args, kws)
        if not kws and isinstance(func, Function) and signature is not None and is_builtin(func, signature):
            self._typed[key] = func, signature  # the function, for its id to stay its own
        return signature


class _Passes(PassManager):
    """Passes that are run one after the other; they are not timed, and numba's listeners do not hear of them."""

    def __init__(self, *passes: type) -> None:
        super().__init__("taxelflow")  # type: ignore[no-untyped-call]
        self._run = [one() for one in passes]

    def run(self, state: Any) -> None:
        """Run them on the state of a compile."""
        for one in self._run:
            one.run_pass(state)


class KernelCompiler(CompilerBase):
    """The passes of a kernel. `IRLegalization` ends the lives of variables: without it arrays are never freed."""

    lowering: type = KernelLowering

    def __init__(self, *arguments: Any) -> None:
        """As numba calls it."""
        super().__init__(*arguments)  # type: ignore[no-untyped-call]
        self.state.flags = _Options(self.state.flags)
        self.state.typingctx = _Types(self.state.typingctx)

    def compile_extra(self, func: Any) -> Any:
        """Compile a function, with room for the calls of all passes."""
        return _with_room(super().compile_extra, func)

    def define_pipelines(self) -> list[PassManager]:
        """One list of passes; there is no other to fall back to."""
        return [
            _Passes(
                TranslateByteCode,
                FixupArgs,
                GenericRewrites,
                ReconstructSSA,
                NopythonTypeInference,
                PreLowerStripPhis,
                IRLegalization,
                self.lowering,
                NoPythonBackend,
            )
        ]


class _Intermediate(JITCodeLibrary):
    """Code that is there to be linked: it is neither optimised as a whole nor emitted, and links nothing itself."""

    def __init__(self, codegen: Any, name: str) -> None:
        super().__init__(codegen, name)  # type: ignore[no-untyped-call]
        self.called: list[Any] = []

    def add_linking_library(self, library: Any) -> None:
        """Keep what this code calls; whoever links this code links it, too."""
        self.called += [library, *getattr(library, "called", ())]

    def finalize(self) -> None:
        """Nothing: numba asks for it before it links this code into a kernel."""


@register_pass(mutates_CFG=True, analysis_only=False)
class _RoutineLowering(KernelLowering):
    """Lowering to intermediate code."""

    _name = "routine_lowering"

    def run_pass(self, state: Any) -> bool:
        """Fill `state.library` and `state.cr`."""
        state.library = _Intermediate(state.targetctx.codegen(), state.func_id.func_qualname)
        state.flags.no_compile = True
        changed: bool = super().run_pass(state)  # type: ignore[no-untyped-call]
        own: list[object] = []
        entry = own.copy  # numba finds the code by its entry from Python, which must be a built-in
        linked = dict.fromkeys([state.library, *state.library.called])
        state.targetctx.insert_user_function(entry, state.cr.fndesc, list(linked))
        state.cr = state.cr._replace(cfunc=entry)
        return changed


class RoutineCompiler(KernelCompiler):
    """The passes of a routine, which Python cannot call."""

    lowering = _RoutineLowering


class LeanCompiler(RoutineCompiler):
    """The passes of a routine that makes no array: references to arrays are not counted in it."""

    def __init__(self, *arguments: Any) -> None:
        """As numba calls it."""
        *_, flags, _locals = arguments
        flags.nrt = False
        super().__init__(*arguments)


@register_pass(mutates_CFG=True, analysis_only=False)
class _VectorLowering(_RoutineLowering):
    """Lowering by `VectorLower`."""

    _name = "vector_lowering"
    lowering_class = VectorLower


class VectorCompiler(LeanCompiler):
    """The passes of a routine that makes no array, and whose loops are vectorised."""

    lowering = _VectorLowering
