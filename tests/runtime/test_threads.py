from __future__ import annotations

import gc

import pytest

from taxelflow.runtime.threads import uncollected


def test_nothing_is_collected_until_the_start_is_over() -> None:
    try:
        with uncollected() as started:
            assert not gc.isenabled()
            started()
            assert gc.isenabled()
            assert gc.get_freeze_count() > 0
            gc.disable()
            started()
            assert not gc.isenabled()  # it has been started once
            gc.enable()
    finally:
        gc.unfreeze()


def test_a_start_that_fails_leaves_collection_as_it_was() -> None:
    try:
        with pytest.raises(ValueError, match="no page"), uncollected():
            raise ValueError("no page")
        assert gc.isenabled()
    finally:
        gc.unfreeze()
