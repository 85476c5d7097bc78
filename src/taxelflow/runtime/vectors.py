"""Loops over taxels that are marked for LLVM to vectorise.

LLVM takes gathers to be dear where the processor has no fast instruction for them (AVX2). There it would evaluate a
pattern taxel by taxel, which takes more than twice as long. And it vectorises no loop that both gathers and stores, for
it cannot know that what is stored is not gathered later.
"""

from __future__ import annotations

from typing import Any

from llvmlite.ir import IntType, MDValue, MetaDataString
from llvmlite.ir.instructions import AllocaInstr, CallInstr, LoadInstr, StoreInstr
from numba.core import ir

from taxelflow.runtime.lowering import KernelLower


class _Group(MDValue):  # type: ignore[misc]  # llvmlite has no types
    """A group of accesses to memory."""

    def descr(self, buf: Any) -> None:
        """As llvmlite calls it, which itself writes no distinct nodes but those for debuggers."""
        buf += ("distinct !{}\n",)


class VectorLower(KernelLower):
    """Lowering of a function whose loops are vectorised, whatever LLVM takes their cost to be. No turn of such a loop
    may read what another one writes.
    """

    def init(self) -> None:
        """As numba calls it."""
        super().init()
        add = self.module.add_metadata
        self._group = _Group(self.module, (), str(len(self.module.metadata)))
        self._marks = (
            add([MetaDataString(self.module, "llvm.loop.vectorize.enable"), IntType(1)(1)]),
            add([MetaDataString(self.module, "llvm.loop.parallel_accesses"), self._group]),
        )

    def lower_inst(self, inst: ir.Stmt) -> Any:
        """Lower a statement; a jump back ends a loop."""
        back = isinstance(inst, ir.Jump) and self.blkmap[inst.target].instructions
        super().lower_inst(inst)
        if back:  # a node for this loop alone begins with itself; the number makes it a new one
            loop = self.module.add_metadata([IntType(64)(len(self.module.metadata)), *self._marks])
            loop.operands = (loop, *self._marks)
            self.builder.block.terminator.set_metadata("llvm.loop", loop)

    def post_lower(self) -> None:
        """Mark all accesses to memory, also those of functions that are called."""
        super().post_lower()  # type: ignore[no-untyped-call]
        for one in (one for block in self.function.blocks for one in block.instructions):
            if isinstance(one, CallInstr) or (isinstance(one, LoadInstr | StoreInstr) and not _on_stack(one)):
                one.set_metadata("llvm.access.group", self._group)


def _on_stack(access: Any) -> bool:
    """Whether a load or a store is of a variable of the function."""
    return any(isinstance(operand, AllocaInstr) for operand in access.operands)
