"""Routines stay in LLVM's intermediate code: it is optimised and emitted once, as part of each kernel that uses it."""

from __future__ import annotations

from typing import Any

from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import PassManager, register_pass
from numba.core.typed_passes import NativeLowering


class IntermediateLibrary(JITCodeLibrary):
    """Code for linking only."""

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True


@register_pass(mutates_CFG=True, analysis_only=False)
class IntermediateLowering(NativeLowering):
    """Lowering without emission of machine code."""

    _name = "intermediate_lowering"

    def run_pass(self, state: Any) -> bool:
        codegen = state.targetctx.codegen()
        state.library = IntermediateLibrary(codegen, state.func_id.func_qualname)
        state.flags.no_compile = True
        changed: bool = super().run_pass(state)
        state.library._ensure_finalized()

        entry = [state.library].copy
        state.targetctx.insert_user_function(entry, state.cr.fndesc, [state.library])
        state["cr"] = state.cr._replace(cfunc=entry)
        return changed


class RoutineCompiler(CompilerBase):
    """The compiler of routines."""

    def define_pipelines(self) -> list[PassManager]:
        manager = DefaultPassBuilder.define_nopython_pipeline(self.state)
        manager.passes = [(IntermediateLowering if one is NativeLowering else one, text) for one, text in manager.passes]
        manager._finalized = False
        manager.finalize()
        return [manager]
