"""Linear algebra of small matrices on one core: BLAS would share each call among all of them, and wait for each."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any

import scipy.linalg  # noqa: F401 - its BLAS is found only once it is loaded
from threadpoolctl import ThreadpoolController

if TYPE_CHECKING:
    from contextlib import AbstractContextManager


def on_one_core() -> AbstractContextManager[Any]:
    """Within this context BLAS uses a single thread."""
    limited: AbstractContextManager[Any] = _blas().limit(limits=1)
    return limited


@cache
def _blas() -> ThreadpoolController:
    """The BLAS libraries, which take a millisecond to find."""
    return ThreadpoolController().select(user_api="blas")
