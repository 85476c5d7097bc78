"""Loops marked for LLVM to vectorise: values equal Python's, and the code has vectors where LLVM alone has none."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numba import njit

from taxelflow.messages import Floats
from taxelflow.runtime import compiling
from taxelflow.runtime.compiling import vector_kernel


def _read(values: Floats, places: Floats, found: Floats) -> float:
    """Gathers, stores, and adds up."""
    total = 0.0
    for i in range(len(places)):
        at = int(places[i])
        known = at >= 0
        value = values[at if known else 0] if known else 0.0
        found[i] = value * value
        total += value
    return total


_vectors = vector_kernel(_read)


@njit
def read(values: Floats, places: Floats, found: Floats) -> float:
    return _vectors(values, places, found)


@given(seed=st.integers(0, 2**32 - 1), taxels=st.integers(0, 40))
def test_values_are_those_of_python(seed: int, taxels: int) -> None:
    random = np.random.default_rng(seed)
    values, places = random.normal(size=50), np.floor(random.uniform(-5, 50, taxels))
    found, expected = np.empty(taxels), np.empty(taxels)
    total = read(values, places, found)
    assert total == pytest.approx(_read(values, places, expected), abs=1e-9)
    np.testing.assert_array_equal(found, expected)


@pytest.mark.skipif(not compiling._VECTOR, reason="of another version of numba loops are not marked")
def test_a_loop_that_gathers_and_stores_uses_vectors() -> None:
    assert _vectors_in(read) > 0


def _vectors_in(function: Any) -> int:
    """Vectors in the code of a kernel."""
    function(np.zeros(8), np.zeros(8), np.zeros(8))
    return len(re.findall(r"<\d+ x double>", function.inspect_llvm(function.signatures[0])))
