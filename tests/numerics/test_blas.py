from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from threading import Event

from threadpoolctl import threadpool_info, threadpool_limits

from taxelflow.numerics.blas import on_one_core


def threads() -> set[int]:
    """Of SciPy's BLAS: other tests of the process load libraries with one of their own."""
    pools = [pool for pool in threadpool_info() if pool["user_api"] == "blas"]
    return {pool["num_threads"] for pool in pools if "scipy" in pool["filepath"].lower()}


def test_blas_stays_on_one_core_until_the_last_thread_has_left() -> None:
    entered, done = Event(), Event()

    def other() -> set[int]:
        with on_one_core():
            entered.set()
            done.wait()
            return threads()

    with threadpool_limits(2, user_api="blas"), ThreadPoolExecutor(1) as beside:
        with on_one_core():
            seen = beside.submit(other)
            entered.wait()
        left_by_one = threads()
        done.set()
        assert (left_by_one, seen.result(), threads()) == ({1}, {1}, {2})


def test_a_thread_beside_one_that_limits_blas_has_one_core_and_leaves_the_other_in_control() -> None:
    def other() -> set[int]:
        with on_one_core():
            return threads()

    with threadpool_limits(2, user_api="blas"), ThreadPoolExecutor(1) as beside:
        assert beside.submit(other).result() == {1}
        assert threads() == {2}
        with threadpool_limits(3, user_api="blas"):
            assert threads() == {3}
