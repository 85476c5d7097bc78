"""Odometry of contacts whose pattern changes."""

from __future__ import annotations

import numpy as np
import pytest

from taxelflow.estimation.template import deforming
from taxelflow.estimation.template.deforming import follow_changing
from taxelflow.estimation.template.observations import Scanned


@pytest.mark.parametrize(("std_rad", "is_reported"), [(0.45, True), (0.55, False)])
def test_an_angle_in_which_positions_are_not_linear_is_not_reported(
    std_rad: float, is_reported: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    places = np.stack([one.ravel() for one in np.meshgrid(np.arange(8.0), np.arange(8.0))])
    readings = np.repeat(np.exp(-0.2 * ((places - 3.5) ** 2).sum(axis=0))[np.newaxis], 6, axis=0)
    scanned = Scanned.of(
        0.01 * np.arange(6), places, readings, np.full_like(readings, 1e-4), np.full(64, np.inf), np.zeros(64)
    )

    def added_up(states: np.ndarray, *_: object, turns: bool) -> tuple[np.ndarray, np.ndarray]:
        pose = np.where([True, True, turns], states[:, :3], np.nan)
        return pose, np.tile(std_rad**2 * np.eye(3), (len(states), 1, 1))

    monkeypatch.setattr(deforming, "_added_up", added_up)
    poses, _ = follow_changing(scanned, 0.003, turns=True)
    assert np.isfinite(poses.pose[:, 2]).all() == is_reported
