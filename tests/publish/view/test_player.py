from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from taxelflow.publish.view.player import Player

TIMES = np.arange(10.0, 13.0, 0.1)


def playing(at_s: float = 10.0, **more: object) -> Player:
    player = Player(**more)  # type: ignore[arg-type]
    player.extend(10.0, 12.9)
    player.seek(at_s)
    return player


def test_time_passes_at_the_speed_that_is_set() -> None:
    player = playing(speed=0.5)
    player.advance(2.0)
    assert player.at_s == 11.0


def test_a_paused_player_stays() -> None:
    player = playing(11.0, playing=False)
    player.advance(1.0)
    assert player.at_s == 11.0


def test_the_end_is_followed_by_the_start() -> None:
    player = playing(12.5)
    player.advance(1.0)
    assert player.at_s == 10.0


@given(st.integers(0, 29), st.integers(-40, 40))
def test_a_step_goes_by_scans_and_stops_at_the_ends(scan: int, scans: int) -> None:
    player = playing(float(TIMES[scan]))
    player.step(TIMES, scans)
    assert player.at_s == TIMES[min(max(scan + scans, 0), 29)]
    assert not player.playing


def test_a_jump_goes_to_the_next_mark_or_the_last_before() -> None:
    player = playing(11.0)
    player.jump([10.5, 11.0, 12.0], back=False)
    assert player.at_s == 12.0
    player.jump([10.5, 11.0, 12.0], back=False)
    assert player.at_s == 12.0
    player.jump([10.5, 11.0, 12.0], back=True)
    assert player.at_s == 11.0


def test_a_live_source_is_followed_until_paused() -> None:
    player = playing(following=True)
    player.extend(10.0, 20.0)
    player.advance(0.01)
    assert player.at_s == 20.0
    player.playing = False
    player.extend(10.0, 21.0)
    player.advance(0.01)
    assert player.at_s == 20.0
