from __future__ import annotations

import numpy as np
import pytest

from taxelflow.control.base import Touch
from taxelflow.control.blindness import Blindness
from taxelflow.control.hold import Hold
from taxelflow.errors import ParameterInvalid

DT_S = 0.01


def touch(scan: int, detail_m: float, slip_m_s: float = 0.0) -> Touch:
    """A scan of an image with this detail, in which both pads say that speed downwards."""
    velocity, noise = np.tile([0.0, -slip_m_s, 0.0], (2, 1)), np.tile(1e-6 * np.eye(3), (2, 1, 1))
    still = np.zeros(2, dtype=bool)
    facing, detail, middle = np.tile(np.eye(2), (2, 1, 1)), np.full(2, detail_m), np.zeros((2, 2))
    pressure = np.full((2, 4), 1e4)
    return Touch(scan * DT_S, DT_S, pressure, 5.0, still, velocity, facing, noise, detail, middle)


@pytest.mark.parametrize(("detail_m", "blind"), [(0.002, False), (0.021, False), (0.031, True), (0.046, True)])
def test_pads_without_detail_are_blind(detail_m: float, blind: bool) -> None:
    session = Blindness().start()
    assert [session.step(touch(scan, detail_m)) for scan in range(5)] == [blind] * 5


def test_pads_without_evidence_leave_it_as_it_was() -> None:
    session = Blindness().start()
    assert not session.step(touch(0, np.nan))
    assert session.step(touch(1, 0.03))
    assert session.step(touch(2, np.nan))


def test_one_scan_does_not_decide() -> None:
    session = Blindness().start()
    for scan in range(50):
        session.step(touch(scan, 0.03))
    assert session.step(touch(50, 0.02))
    seen = [session.step(touch(scan, 0.002)) for scan in range(51, 100)]
    assert not seen[-1]


def test_blind_pads_squeeze_once_by_the_growth_that_is_to_be_borne() -> None:
    controller = Hold(blind_times=3.0).start(4.0, 40.0)
    forces = [controller.step(touch(scan, 0.03)) for scan in range(300)]
    assert forces == pytest.approx([12.0] * 300)  # and do not relax
    assert controller.blind
    weak = Hold(blind_times=30.0).start(4.0, 40.0)
    assert weak.step(touch(0, 0.03)) == 40.0


def test_blind_pads_that_agree_on_a_slip_still_squeeze_more() -> None:
    controller = Hold().start(1.0, 40.0)
    forces = [controller.step(touch(scan, 0.03, 0.05)) for scan in range(20)]
    assert forces[-1] > 4.5


@pytest.mark.parametrize("name", ["detail_m", "memory_s"])
def test_a_blindness_out_of_range_is_refused(name: str) -> None:
    with pytest.raises(ParameterInvalid, match=rf"blindness\.{name} must be"):
        Blindness(**{name: 0.0})
