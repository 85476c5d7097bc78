"""The process that works beside a stream, when who asks it is gone."""

from __future__ import annotations

import io
import pickle

import pytest

from taxelflow.runtime.worker import serve


@pytest.mark.parametrize("left", [0, 1, -1])
def test_requests_may_end_in_the_middle_of_one(left: int) -> None:
    request = pickle.dumps((max, ([1.0] * 1000,)))
    results = io.BytesIO()
    serve(io.BytesIO(request + request[:left]), results)
    assert pickle.loads(results.getvalue()) == (1.0, None)
