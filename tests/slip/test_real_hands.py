"""What the monitor makes of recordings of real hands, whose names say what happens."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Literal

import numpy as np
import pytest

from taxelflow.messages import RawScans, cut, joined
from taxelflow.pipeline import api

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


@pytest.mark.long
def test_the_slip_of_a_real_hand_is_found(recordings: Path) -> None:
    # Starts of the template disagree about this leap on some processors: no pose of it is `ok` then.
    result = api.estimate(recordings / "sdh-bags" / "slip_up.bag", method="convolution")
    begin_s = result.slips.t_s[0]
    start, stop, *more = (event for event in result.events if event.event in {"slip_start", "slip_stop"})
    # From scan 105 to 107 the patch leaps from the taxels round 55 to taxel 39 of the pad, 17 mm away.
    assert (start.pad, start.event, stop.event) == ("finger1_distal", "slip_start", "slip_stop")
    assert 3.3 < start.onset_s - begin_s < stop.onset_s - begin_s < 3.5
    assert stop.direction_rad == pytest.approx(2.5, abs=0.2)
    assert stop.speed_m_s > 0.1
    assert more == []


@pytest.mark.long
def test_a_real_object_that_slides_over_a_finger_slips_each_time(recordings: Path) -> None:
    path = recordings / "sdh-dsa" / "slip_examples_pen_and_wooden_block.dsa"
    whole = api.read(path)

    def first() -> Iterator[RawScans]:
        yield cut(joined(list(whole.blocks())), 0, 600)

    result = api.estimate(replace(whole, read=first, scans=600), method="template", mode="stream")
    finger = result.pads.index("finger2_distal")
    edges = np.flatnonzero(np.diff(result.slips.contact[:, finger], prepend=False, append=False)).reshape(-1, 2)
    long = [(begin, end) for begin, end in edges.tolist() if end - begin >= 15]
    assert len(long) > 5
    assert all(result.slipping[begin:end, finger].any() for begin, end in long)


@pytest.mark.long
@pytest.mark.parametrize("mode", ["batch", "stream"])
def test_a_real_hand_that_holds_has_no_slip(mode: Literal["batch", "stream"], recordings: Path) -> None:
    result = api.estimate(recordings / "sdh-bags" / "no_slippage.bag", method="template", mode=mode)
    young_s = result.slips.t_s[0] + (0.6 if mode == "stream" else 0.0)  # a stream learns from a hand that holds already
    assert [event for event in result.events if event.event == "slip_start" and event.onset_s > young_s] == []
