"""Checks of parameters; each raises ParameterInvalid."""

from __future__ import annotations

from taxelflow.errors import ParameterInvalid


def positive(name: str, value: float) -> None:
    """Finite and above 0."""
    if not 0 < value < float("inf"):
        raise ParameterInvalid(name, value, "be a finite number above 0")


def not_negative(name: str, value: float) -> None:
    """Finite, and 0 or more."""
    if not 0 <= value < float("inf"):
        raise ParameterInvalid(name, value, "be 0 or more")


def within(name: str, value: float, low: float, high: float) -> None:
    """From low to high."""
    if not low <= value <= high:
        raise ParameterInvalid(name, value, f"be between {low:g} and {high:g}")


def at_least(name: str, value: int, least: int) -> None:
    """A number that is not smaller."""
    if value < least:
        raise ParameterInvalid(name, value, f"be at least {least}")
