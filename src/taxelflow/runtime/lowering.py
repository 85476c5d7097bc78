"""How numba's typed statements become LLVM's intermediate code, in less of it than `numba.core.lowering.Lower` writes.

LLVM makes the same of it. numba copies an array's record to the stack for each element that is read or written, and
looks for the code of each operator, each count of references and the size of each variable. Here an element is
addressed by the fields of the array's record, an operator is looked for once, and numbers are not counted.
"""

from __future__ import annotations

import operator
from typing import Any, ClassVar

from llvmlite.ir import ArrayType, Constant
from numba.core import cgutils, ir, types
from numba.core.lowering import Lower
from numba.np.arrayobj import fix_integer_index, load_item, store_item


class KernelLower(Lower):
    """Lowering of one function."""

    _called: ClassVar[dict[tuple[object, ...], tuple[Any, Any]]] = {}
    """The function type and signature of each operator on types."""
    _counted: ClassVar[dict[types.Type, bool]] = {}
    """Whether a type holds references that are counted."""

    def init(self) -> None:
        """As numba calls it."""
        super().init()  # type: ignore[no-untyped-call]
        self._found: dict[tuple[object, ...], Any] = {}

    def lower_block(self, block: ir.Block) -> None:
        """Lower a block's statements."""
        self.pre_block(block)
        try:
            for statement in block.body:
                self.loc = statement.loc
                self.lower_inst(statement)
        except Exception as error:
            error.add_note(f"while lowering {self.loc}")
            raise
        self.post_block(block)

    def lower_inst(self, inst: ir.Stmt) -> Any:
        """Lower a statement."""
        if isinstance(inst, ir.Assign) and not isinstance(inst.value, ir.Arg):
            value = self.lower_assign(self.typeof(inst.target.name), inst)
            self.storevar(value, inst.target.name)
        elif not isinstance(inst, ir.Del):
            return super().lower_inst(inst)  # type: ignore[no-untyped-call]
        elif self._is_counted(self.typeof(inst.value)):
            self.delvar(inst.value)
        return None

    def lower_expr(self, resty: types.Type, expr: ir.Expr) -> Any:
        """Lower an expression."""
        of, lower = _EXPRESSIONS.get(expr.op, (None, None))
        if of is not None and isinstance(type_ := self.typeof(expr.value.name), of):
            return lower(self, resty, expr, type_)
        return super().lower_expr(resty, expr)  # type: ignore[no-untyped-call]

    def alloca_lltype(self, name: str, lltype: Any, datamodel: object = None) -> Any:
        """Room for a variable, without debug information."""
        return cgutils.alloca_once(self.builder, lltype, name=name, zfill=False)

    def incref(self, typ: types.Type, val: Any) -> None:
        """Count a reference, if the type has any."""
        if self._is_counted(typ):
            super().incref(typ, val)  # type: ignore[no-untyped-call]

    def decref(self, typ: types.Type, val: Any) -> None:
        """Give up a reference, if the type has any."""
        if self._is_counted(typ):
            super().decref(typ, val)  # type: ignore[no-untyped-call]

    def lower_binop(self, resty: types.Type, expr: ir.Expr, op: Any) -> Any:
        """Lower an operator of two operands."""
        if expr.static_lhs is not ir.UNDEFINED or expr.static_rhs is not ir.UNDEFINED:
            return super().lower_binop(resty, expr, op)  # type: ignore[no-untyped-call]
        signature = self.fndesc.calltypes[expr]
        operands = [self._cast(one, to) for one, to in zip((expr.lhs, expr.rhs), signature.args, strict=True)]
        found = self._implementation(op, signature.args)(self.builder, operands)
        return self.context.cast(self.builder, found, signature.return_type, resty)

    def lower_getitem(self, resty: types.Type, expr: ir.Expr, value: ir.Var, index: ir.Var, signature: Any) -> Any:
        """Lower the read of an element or a view."""
        array, at = signature.args
        operands = [self._cast(value, array), self._cast(index, at)]
        if _is_element(array, at):
            found = load_item(self.context, self.builder, array, self._pointer(array, at, *operands))
        else:
            found = self._implementation(operator.getitem, signature.args)(self.builder, operands)
        return self.context.cast(self.builder, found, signature.return_type, resty)

    def lower_setitem(self, target_var: ir.Var, index_var: ir.Var, value_var: ir.Var, signature: Any) -> Any:
        """Lower the write of an element or a view."""
        array, at, of = signature.args
        operands = [self._cast(target_var, array), self._cast(index_var, at)]
        value = self._cast(value_var, of)
        if not _is_element(array, at):
            return self._implementation(operator.setitem, signature.args)(self.builder, [*operands, value])
        pointer = self._pointer(array, at, *operands)
        value = self.context.cast(self.builder, value, of, array.dtype)
        store_item(self.context, self.builder, array, value, pointer)
        return None

    def _static_getitem(self, resty: types.Type, expr: ir.Expr, _type: types.Array) -> Any:
        """An element or a view of an array, as with an index that is a variable; a field by its name is numba's."""
        if isinstance(expr.index, str):
            return super().lower_expr(resty, expr)  # type: ignore[no-untyped-call]
        return self.lower_getitem(resty, expr, expr.value, expr.index_var, self.fndesc.calltypes[expr])

    def _getattr(self, resty: types.Type, expr: ir.Expr, record: types.Record) -> Any:
        """A field of a record. An array there is its data; its shape is that of its type."""
        if not isinstance(resty, types.NestedArray):
            return super().lower_expr(resty, expr)  # type: ignore[no-untyped-call]
        builder, fields = self.builder, self.context.data_model_manager[resty]
        size = self.context.get_value_type(types.intp)
        self.context.sentry_record_alignment(record, expr.attr)
        pointer = cgutils.get_record_member(
            builder,
            self.loadvar(expr.value.name),
            record.offset(expr.attr),
            self.context.get_data_type(resty.dtype),
        )
        array = Constant(fields.get_value_type(), None)
        for field, value in {
            "data": pointer,
            "nitems": size(resty.nitems),
            "itemsize": size(resty.size),
            "shape": Constant(ArrayType(size, resty.ndim), [size(one) for one in resty.shape]),
            "strides": Constant(ArrayType(size, resty.ndim), [size(one) for one in resty.strides]),
        }.items():
            array = fields.set(builder, array, value, field)
        return array

    def _getiter(self, resty: types.Type, expr: ir.Expr, range_: types.RangeType) -> Any:
        """An iterator of a range: where its next value is, its stop and step, and where the count of values left is."""
        builder, size = self.builder, self.context.get_value_type(range_.dtype)
        start, stop, step = cgutils.unpack_tuple(builder, self.loadvar(expr.value.name), 3)
        following, left = (cgutils.alloca_once(builder, size) for _ in range(2))
        builder.store(start, following)
        zero = size(0)
        difference = builder.sub(stop, start)
        rises = builder.icmp_signed(">", difference, zero)
        differs = builder.xor(rises, builder.icmp_signed(">", step, zero))
        with cgutils.if_unlikely(builder, builder.icmp_unsigned("==", step, zero)):
            self.context.call_conv.return_user_exc(builder, ValueError, ("range() arg 3 must not be zero",))
        with builder.if_else(differs) as (none, some):
            with none:
                builder.store(zero, left)
            with some:
                rest = builder.srem(difference, step)
                rest = builder.select(rises, rest, builder.neg(rest))
                is_more = builder.icmp_signed(">", rest, zero)
                whole = builder.sdiv(difference, step)
                builder.store(builder.add(whole, builder.select(is_more, size(1), zero)), left)
        iterator = Constant(self.context.get_value_type(resty), None)
        for place, value in enumerate((following, stop, step, left)):
            iterator = builder.insert_value(iterator, value, place)
        return iterator

    def _iternext(self, resty: types.Type, expr: ir.Expr, iterator: Any) -> Any:
        """The next value of a range, and whether there is one."""
        builder, size = self.builder, self.context.get_value_type(iterator.yield_type)
        following, _stop, step, left = cgutils.unpack_tuple(builder, self.loadvar(expr.value.name), 4)
        count = builder.load(left)
        is_valid = builder.icmp_signed(">", count, size(0))
        before = builder.basic_block
        with builder.if_then(is_valid):
            value = builder.load(following)
            builder.store(builder.sub(count, size(1), flags=["nsw"]), left)
            builder.store(builder.add(value, step), following)
            found = builder.basic_block
        chosen = builder.phi(size)
        chosen.add_incoming(value, found)
        chosen.add_incoming(size(0), before)
        pair = builder.insert_value(Constant(self.context.get_value_type(resty), None), chosen, 0)
        return builder.insert_value(pair, is_valid, 1)

    def _pair_first(self, resty: types.Type, expr: ir.Expr, _pair: types.Pair) -> Any:
        """The next value of an iterator."""
        value = self.builder.extract_value(self.loadvar(expr.value.name), 0)
        self.incref(resty, value)
        return value

    def _pair_second(self, _resty: types.Type, expr: ir.Expr, _pair: types.Pair) -> Any:
        """Whether an iterator has a next value."""
        return self.builder.extract_value(self.loadvar(expr.value.name), 1)

    def _cast(self, variable: ir.Var, to: types.Type) -> Any:
        """A variable's value as another type."""
        return self.context.cast(self.builder, self.loadvar(variable.name), self.typeof(variable.name), to)

    def _is_counted(self, type_: types.Type) -> bool:
        counted = self._counted.get(type_)
        if counted is None:
            counted = self._counted[type_] = bool(self.context.data_model_manager[type_].contains_nrt_meminfo())
        return counted

    def _implementation(self, op: Any, types_: tuple[types.Type, ...]) -> Any:
        """The code of an operator on types."""
        key = op, types_
        if key not in self._found:
            function, signature = self._called.get(key, (None, None))
            if function is None:
                typing = self.context.typing_context
                function = typing.resolve_value_type(op)
                signature = function.get_call_type(typing, types_, {})
                if is_builtin(function, signature):
                    self._called[key] = function, signature
            self._found[key] = self.context.get_function(function, signature)
        return self._found[key]

    def _pointer(self, array: types.Array, at: types.Type, value: Any, index: Any) -> Any:
        """Where an element is. value: the array's record. index: one integer, or a tuple of them."""
        builder, fields = self.builder, self.context.data_model_manager[array]
        kinds, indexes = _kinds(at), [index]
        if isinstance(at, types.BaseTuple):
            indexes = cgutils.unpack_tuple(builder, index, len(kinds))
        shape = cgutils.unpack_tuple(builder, fields.get(builder, value, "shape"), array.ndim)
        fixed = [
            fix_integer_index(self.context, builder, kind, one, size)
            for kind, one, size in zip(kinds, indexes, shape, strict=True)
        ]
        strides = []
        if array.layout == "A":
            strides = cgutils.unpack_tuple(builder, fields.get(builder, value, "strides"), array.ndim)
        data = fields.get(builder, value, "data")
        return cgutils.get_item_pointer2(self.context, builder, data, shape, strides, array.layout, fixed)


_EXPRESSIONS: dict[str, tuple[Any, Any]] = {
    "static_getitem": (types.Array, KernelLower._static_getitem),
    "getattr": (types.Record, KernelLower._getattr),
    "getiter": (types.RangeType, KernelLower._getiter),
    "iternext": (types.RangeIteratorType, KernelLower._iternext),
    "pair_first": (types.Pair, KernelLower._pair_first),
    "pair_second": (types.Pair, KernelLower._pair_second),
}
"""Expressions that are lowered here, by the type of their value."""


def is_builtin(function: Any, signature: Any) -> bool:
    """Whether numba has the code of a call, and it is the same for all options; other code is compiled for each."""
    return function.get_impl_key(signature) is function.typing_key


def _kinds(at: types.Type) -> list[types.Type]:
    """Types of an index: one, or those in a tuple."""
    return list(getattr(at, "types", (at,)))


def _is_element(array: Any, at: types.Type) -> bool:
    """Whether an index is of one element of an array: of a number or a record."""
    kinds = _kinds(at)
    return (
        isinstance(array, types.Array)
        and len(kinds) == array.ndim
        and all(isinstance(kind, types.Integer) for kind in kinds)
        and not isinstance(array.dtype, types.Array)
    )
