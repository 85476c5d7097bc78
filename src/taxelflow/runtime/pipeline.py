"""How numba compiles kernels and routines: only the passes that they need, and machine code for kernels only.

numba optimises a function and emits machine code for it, then does so again in each function that calls it. Nobody
calls a routine but kernels: here it stays in LLVM's intermediate code, which is optimised and emitted once, as a part
of each kernel. The passes are those of numba's `DefaultPassBuilder` without the ones for closures, literals, loops over
tuples, array expressions and reports, which kernels do not use.
"""

from __future__ import annotations

from typing import Any

from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase
from numba.core.compiler_machinery import PassManager, register_pass
from numba.core.typed_passes import (
    IRLegalization,
    NativeLowering,
    NoPythonBackend,
    NopythonTypeInference,
    PreLowerStripPhis,
)
from numba.core.untyped_passes import FixupArgs, GenericRewrites, IRProcessing, ReconstructSSA, TranslateByteCode


class KernelCompiler(CompilerBase):
    """The passes of a kernel. `IRLegalization` ends the lives of variables: without it arrays are never freed."""

    lowering: type = NativeLowering

    def define_pipelines(self) -> list[PassManager]:
        """One list of passes; there is no other to fall back to."""
        passes = PassManager("taxelflow")
        for one in (
            TranslateByteCode,
            FixupArgs,
            IRProcessing,
            GenericRewrites,
            ReconstructSSA,
            NopythonTypeInference,
            PreLowerStripPhis,
            IRLegalization,
            self.lowering,
            NoPythonBackend,
        ):
            passes.add_pass(one, one.__name__)
        passes.finalize()
        return [passes]


class _Intermediate(JITCodeLibrary):
    """Code that is there to be linked: it is neither optimised as a whole nor emitted."""

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True


@register_pass(mutates_CFG=True, analysis_only=False)
class _RoutineLowering(NativeLowering):
    """Lowering to intermediate code."""

    _name = "routine_lowering"

    def run_pass(self, state: Any) -> bool:
        """Fill `state.library` and `state.cr`."""
        state.library = _Intermediate(state.targetctx.codegen(), state.func_id.func_qualname)
        state.flags.no_compile = True
        changed: bool = super().run_pass(state)  # type: ignore[no-untyped-call]
        own: list[object] = []
        entry = own.copy  # numba finds the code by its entry from Python, which must be a built-in
        state.targetctx.insert_user_function(entry, state.cr.fndesc, [state.library])
        state.cr = state.cr._replace(cfunc=entry)
        return changed


class RoutineCompiler(KernelCompiler):
    """The passes of a routine, which Python cannot call."""

    lowering = _RoutineLowering
