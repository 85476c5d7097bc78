from __future__ import annotations

import gc

import pytest

from taxelflow.runtime.threads import short_collections, uncollected


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


def test_short_collections_search_fewer_objects_at_once_and_end_with_their_context() -> None:
    before = gc.get_threshold()
    with pytest.raises(ValueError, match="no scan"), short_collections():
        new, young, old = gc.get_threshold()
        assert (new, young) <= before[:2]
        assert old > before[2]
        raise ValueError("no scan")
    assert gc.get_threshold() == before
