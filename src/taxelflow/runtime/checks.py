"""Checks of parameters; each raises ParameterInvalid."""

from __future__ import annotations

from dataclasses import fields
from numbers import Real
from typing import TYPE_CHECKING

from taxelflow.errors import ParameterInvalid

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


def number(name: str, value: object) -> None:
    """A number: not text, a list or a yes."""
    if isinstance(value, bool) or not isinstance(value, Real):
        raise ParameterInvalid(name, value, "be a number")


def numeric(parameters: DataclassInstance, prefix: str = "") -> None:
    """A number in each field that is declared as one; a comparison with anything else would be an error of Python."""
    for one in fields(parameters):
        if one.type in ("float", "int"):
            number(prefix + one.name, getattr(parameters, one.name))


def positive(name: str, value: float) -> None:
    """Finite and above 0."""
    number(name, value)
    if not 0 < value < float("inf"):
        raise ParameterInvalid(name, value, "be a finite number above 0")


def not_negative(name: str, value: float) -> None:
    """Finite, and 0 or more."""
    number(name, value)
    if not 0 <= value < float("inf"):
        raise ParameterInvalid(name, value, "be 0 or more")


def within(name: str, value: float, low: float, high: float) -> None:
    """From low to high."""
    number(name, value)
    if not low <= value <= high:
        raise ParameterInvalid(name, value, f"be between {low:g} and {high:g}")


def at_least(name: str, value: int, least: int) -> None:
    """A number that is not smaller."""
    number(name, value)
    if value < least:
        raise ParameterInvalid(name, value, f"be at least {least}")
