from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from costly import mostly_long
from taxelflow.estimation.template import warmup
from taxelflow.numerics import banded, blas
from taxelflow.pipeline.api import estimate, estimator

if TYPE_CHECKING:
    from taxelflow.acquire.base import Recording
    from taxelflow.estimation.base import Mode


@pytest.mark.parametrize("mode", mostly_long(["batch", "stream"], "batch"))
def test_no_factorisation_is_shared_among_cores(mode: Mode, stroke: Recording, monkeypatch: pytest.MonkeyPatch) -> None:
    """A factorisation of 1 ms takes 300 ms where four threads wait for each other."""
    seen: set[int] = set()
    known = {pool["filepath"] for pool in blas._blas().info()}  # other tests load libraries with a BLAS of their own
    factorise = banded.dpbtrf

    def noted(*arguments: object, **options: object) -> object:
        seen.update(pool["num_threads"] for pool in threadpool_info() if pool["filepath"] in known)
        return factorise(*arguments, **options)

    monkeypatch.setattr(banded, "dpbtrf", noted)
    warmup.compile_batch.cache_clear()
    warmup.compile_stream.cache_clear()
    with threadpool_limits(2, user_api="blas"):
        estimate(stroke, estimator("template"), mode=mode)
    assert seen == {1}
