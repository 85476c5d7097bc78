"""Named records: a class of annotated fields describes a numpy record dtype, for kernels and for the type checker.

Kernels read and write a record by field name: `last: Centroid = history[pad, 0]`, then `last.x = 1.0`. A nested record
and an array field are views. A kernel must not create a record array of its own: numba frees the array while its
records are still in use. Scratch values are fields of a state instead.
"""

from __future__ import annotations

from functools import cache
from typing import Annotated, Any, TypeVar, cast, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from taxelflow.messages import Floats

Records = NDArray[np.void]
Fields = TypeVar("Fields")
Vector = Annotated[Floats, 3]
"""(3,) floats along x, y, theta."""


@cache
def record_dtype(fields: type) -> np.dtype[np.void]:
    """Record dtype of an annotated class.

    A field is float, int, bool, another such class (a nested record), `Annotated[Floats, *shape]` (an array of floats)
    or `Annotated[Records, record, *shape]` (an array of records).
    """
    hints = get_type_hints(fields, include_extras=True)
    return np.dtype([_field(name, hint) for name, hint in hints.items()], align=True)


def _field(name: str, hint: Any) -> tuple[Any, ...]:
    if get_origin(hint) is not Annotated:
        return (name, hint if hint in (float, int, bool) else record_dtype(hint))
    first, *others = hint.__metadata__
    return (name, record_dtype(first), tuple(others)) if isinstance(first, type) else (name, float, hint.__metadata__)


def records(fields: type, *shape: int) -> Records:
    """Records of this class, every field 0."""
    return np.zeros(shape, dtype=record_dtype(fields))


def unknown(fields: type, *shape: int) -> Records:
    """Records of this class, all of whose fields are floats, every one NaN."""
    dtype = record_dtype(fields)
    floats = np.empty((*shape, dtype.itemsize // 8))
    floats.fill(np.nan)
    return np.ndarray(shape, dtype, floats)  # a third of the time of a view


class _Field:
    """A field as an attribute, read in a tenth of the time that `np.recarray` takes."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __get__(self, one: _Record, _owner: type) -> Any:
        return one.__dict__[self._name][()]  # a number, or a view of an array

    def __set__(self, one: _Record, value: object) -> None:
        one.__dict__[self._name][()] = value


class _Record:
    """A record by attribute: views of its fields, made once."""

    def __init__(self, held: Records) -> None:
        """held: (), the record."""
        for name in held.dtype.names or ():
            self.__dict__[name] = _by_attribute(held[name]) if held.dtype[name].names else held[name]


@cache
def _attributes(dtype: np.dtype[np.void]) -> type[_Record]:
    return type("Attributes", (_Record,), {name: _Field(name) for name in dtype.names or () if not dtype[name].names})


def _by_attribute(held: Records) -> _Record:
    return _attributes(held.dtype)(held)


def record(fields: type[Fields], held: Records, number: int = 0) -> Fields:
    """One record of an array, by attribute, for code outside kernels. Writing to a field writes to the array."""
    return cast("Fields", _by_attribute(held[number : number + 1].reshape(())))
