"""Cases of parametrised tests that `make test` leaves to `make test-long`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from collections.abc import Iterable


def mostly_long(cases: Iterable[Any], *quick: Any) -> list[Any]:
    """The cases, of which all but the quick ones are `long`."""
    cases = list(cases)
    assert all(case in cases for case in quick)
    marked = ((case if isinstance(case, tuple) else (case,)) for case in cases)
    return [
        case if case in quick else pytest.param(*values, marks=pytest.mark.long)
        for case, values in zip(cases, marked, strict=True)
    ]
