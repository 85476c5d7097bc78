"""What a skin may remember of a load that is gone."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from elastic_skin import SENSOR as SKIN
from elastic_skin import pressed
from synthetic import grid_sensor, recorded
from taxelflow.contacts.skin_memory import SkinMemory
from taxelflow.messages import OK, Bools, Floats
from taxelflow.pipeline.api import estimate

SENSOR = grid_sensor(4, 4)
UNSEEN = SENSOR.layout.unseen_error
RATE_HZ = 100.0


def remembered(peak: Floats, block: int = 1000) -> Bools:
    """(scans,), of one pad. peak: (scans,)."""
    memory, t_s = SkinMemory(SENSOR.layout), np.arange(len(peak)) / RATE_HZ
    starts = range(0, len(peak), block)
    return np.concatenate([memory.step(t_s[k : k + block], peak[k : k + block, np.newaxis])[:, 0] for k in starts])


def test_what_is_left_after_a_release_may_be_the_skins_and_later_a_light_touch() -> None:
    peak = np.concatenate([np.full(100, 1.0), np.full(400, UNSEEN)])
    found = remembered(peak)
    assert not found[:100].any()
    assert found[100:200].all()
    assert not found[300:].any()  # three seconds after: a light touch


def test_a_light_touch_before_a_load_is_one() -> None:
    assert not remembered(np.concatenate([np.full(50, UNSEEN), np.full(50, 1.0)])).any()


def test_a_load_of_a_fifth_is_one() -> None:
    assert not remembered(np.concatenate([np.full(50, 1.0), np.full(50, 4.0 * UNSEEN)])).any()


def test_it_fades_without_a_contact_too() -> None:
    peak = np.full(500, np.nan)
    peak[:50], peak[52:60], peak[400:] = 1.0, UNSEEN, UNSEEN
    found = remembered(peak)
    assert found[52:60].all()
    assert not found[60:].any()


@given(hnp.arrays(float, st.integers(1, 60), elements=st.floats(0.0, 1.0) | st.just(np.nan)), st.integers(1, 9))
def test_blocks_do_not_matter(peak: Floats, block: int) -> None:
    np.testing.assert_array_equal(remembered(peak, block), remembered(peak))


@pytest.mark.parametrize("method", ["convolution", "template"])
def test_no_pose_of_what_a_skin_remembers_is_ok(method: str) -> None:
    """A pressed object is lifted: 6 % of the pattern is left, and creeps back."""
    idle, pressed_for, left_for = (np.zeros((round(50 * s), 1)) for s in (1.0, 1.5, 1.0))
    left = 0.06 * np.exp(-np.arange(len(left_for)) / 50.0)[:, np.newaxis]
    values = 2e4 * np.concatenate([idle, pressed_for + 1.0, left]) * pressed()
    noisy = values + np.random.default_rng(1).normal(0.0, 50.0, values.shape)
    slips = estimate(recorded(noisy, SKIN, np.arange(len(noisy)) / 50.0), method, mode="stream").slips
    lifted = len(idle) + len(pressed_for)
    assert (slips.quality[lifted - 20 : lifted, 0] == OK).all()
    assert slips.contact[lifted:, 0].sum() > 10
    assert not (slips.quality[lifted:, 0] == OK).any()
