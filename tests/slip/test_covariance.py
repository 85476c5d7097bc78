from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from compiled import compiled
from taxelflow.messages import Floats
from taxelflow.numerics.records import records
from taxelflow.slip.covariance import (
    Cholesky,
    Covariance,
)
from taxelflow.slip.covariance import (
    factorize as _factorize,
)
from taxelflow.slip.covariance import (
    multiply as _multiply,
)
from taxelflow.slip.covariance import (
    translation_axes as _translation_axes,
)
from taxelflow.slip.covariance import (
    translation_variance as _translation_variance,
)
from taxelflow.slip.covariance import (
    whiten as _whiten,
)

translation_variance = compiled(_translation_variance)
translation_axes = compiled(_translation_axes)
factorize = compiled(_factorize)
whiten = compiled(_whiten)
multiply = compiled(_multiply)


def packed(matrix: Floats, *unknown: int) -> Any:
    covariance = records(Covariance, 1)[0]
    covariance["variance"] = np.where(np.isin(np.arange(3), unknown), np.nan, np.diag(matrix))
    for name, (one, other) in {"xy": (0, 1), "xt": (0, 2), "yt": (1, 2)}.items():
        covariance[name] = 0.0 if {one, other} & set(unknown) else matrix[one, other]
    return covariance


def factor_of(covariance: Any) -> tuple[Any, bool]:
    factor = records(Cholesky, 1)[0]
    return factor, factorize(covariance, factor)


@given(entries=st.lists(st.floats(-3, 3), min_size=9, max_size=9), residual=st.tuples(*[st.floats(-9, 9)] * 3))
def test_the_factor_is_that_of_cholesky_and_a_whitened_residual_has_the_mahalanobis_length(
    entries: list[float], residual: tuple[float, float, float]
) -> None:
    root = np.array(entries).reshape(3, 3)
    matrix = root @ root.T + np.eye(3)
    factor, yaw_known = factor_of(packed(matrix))
    assert yaw_known
    np.testing.assert_allclose(
        [factor[name] for name in ("xx", "yx", "yy", "tx", "ty", "tt")],
        np.linalg.cholesky(matrix)[np.tril_indices(3)],
        atol=1e-12,
    )
    e = np.array(residual)
    assert whiten(factor, e) == pytest.approx(residual @ np.linalg.solve(matrix, residual), abs=1e-9)
    np.testing.assert_allclose(np.linalg.cholesky(matrix) @ e, residual, atol=1e-9)


@pytest.mark.parametrize("unknown", [(0,), (1,), (2,), (0, 2), (1, 2)], ids=str)
def test_an_unknown_coordinate_counts_for_nothing(unknown: tuple[int, ...]) -> None:
    matrix = np.array([[2.0, 0.5, 0.3], [0.5, 1.0, -0.2], [0.3, -0.2, 3.0]])
    known = [axis for axis in range(3) if axis not in unknown]
    covariance = packed(matrix, *unknown)
    factor, yaw_known = factor_of(covariance)
    assert yaw_known == (2 in known)
    e = np.array([1.0, -2.0, 0.5])
    residual = e[known]
    assert whiten(factor, e) == pytest.approx(residual @ np.linalg.solve(matrix[np.ix_(known, known)], residual))
    assert (e[list(unknown)] == 0.0).all()
    places = [axis for axis in known if axis < 2]
    assert translation_axes(covariance) == len(places)
    assert translation_variance(covariance) == pytest.approx(np.mean(np.diag(matrix)[places]))


def test_a_covariance_that_is_singular_to_rounding_has_a_factor() -> None:
    singular = np.diag([131391.9, 129337.9, 0.01])
    singular[0, 1] = singular[1, 0] = -130360.9
    assert np.linalg.det(singular) < 0.0
    factor = records(Cholesky, 1)
    assert factorize(packed(singular), factor[0])
    residual = np.array([1.0, 1.0, 0.1])
    assert np.isfinite(whiten(factor[0], residual))


def test_a_multiple_of_a_covariance_keeps_what_is_unknown() -> None:
    matrix = np.array([[2.0, 0.5, 0.3], [0.5, 1.0, -0.2], [0.3, -0.2, 3.0]])
    covariance = packed(matrix, 2)
    multiply(covariance, 4.0)
    np.testing.assert_array_equal(covariance["variance"], [8.0, 4.0, np.nan])
    assert (covariance["xy"], covariance["xt"]) == (2.0, 0.0)
    covariance = packed(matrix)
    multiply(covariance, 4.0)
    assert (covariance["xt"], covariance["yt"]) == (1.2, -0.8)
