from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rigged import rigged
from taxelflow import api
from taxelflow.acquire.rig.simulate import simulate

if TYPE_CHECKING:
    from taxelflow.messages import Floats


def seen(**changes: object) -> tuple[Floats, Floats]:
    """Places (scans, 2) of an object at a border, as a batch sees them and as they are, in mm, the mean taken off."""
    recording = simulate(rigged("hold-at-edge", sensing={"rate_hz": 30.0}, **changes))
    slips, truth = api.estimate(recording, "template").slips, recording.known_truth
    pad = recording.layout.pads.index(truth.pad)
    known = np.isfinite(slips.pose[:, pad, 0])
    places = 1e3 * np.stack([slips.pose[known, pad, :2], truth.pose[known, :2]])
    found, true = places - places.mean(axis=1, keepdims=True)
    return found, true


def test_growth_at_a_border_is_no_motion() -> None:
    found, _ = seen(motion={"turn_s": 4.0}, load={"cycles": 2})
    assert np.ptp(found, axis=0).max() < 0.5  # taken for motion, it is 3.4 mm


def test_an_object_that_slides_along_the_border_as_it_is_pressed_has_moved() -> None:
    slide = {"travel_m": 0.006, "speed_m_s": 0.002, "direction_rad": np.pi / 2, "rest_s": 1.0}
    found, true = seen(motion=slide, load={"cycles": 2})
    assert np.sqrt(np.mean((found - true)[:, 1] ** 2)) < 0.2


def test_a_load_that_changes_for_a_short_time_does_not_move_what_stays() -> None:
    recording = simulate(rigged("hold-pressed", motion={"turn_s": 4.0}, load={"cycles": 2}, sensing={"rate_hz": 40.0}))
    pose = 1e3 * api.estimate(recording, "template").slips.pose[:, 0, :2]
    assert np.nanstd(pose, axis=0).max() < 0.1  # with gains held at 1, it is 0.2 mm
