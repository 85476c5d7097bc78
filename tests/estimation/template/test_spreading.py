from __future__ import annotations

import numpy as np

from taxelflow.estimation.template.online.spreading import TURN, Turns, most_at_once


def test_at_100_hz_all_pads_have_a_turn_in_each_scan() -> None:
    turns, most = Turns(7), most_at_once(7, 0.01)
    assert most == 7
    for scan in range(5):
        assert turns.taken(range(7), 0.01 * scan, most) == list(range(7))


def test_at_1_khz_one_pad_has_a_turn_in_a_scan_and_none_waits_longer_than_its_time() -> None:
    turns, most = Turns(7), most_at_once(7, 0.001)
    assert most == 1
    taken = [turns.taken(range(7), 0.001 * scan, most) for scan in range(100)]
    assert max(map(len, taken)) == 1
    for pad in range(7):
        own = [scan for scan, pads in enumerate(taken) if pad in pads]
        assert np.diff(own).max() <= 1000 * TURN.every_s + 1


def test_who_has_waited_longest_comes_first() -> None:
    turns = Turns(3)
    assert turns.taken([2], 1.0, 1) == [2]
    assert turns.taken([2, 0], 2.0, 1) == [0]
    assert turns.taken([0, 2], 3.0, 1) == [2]
    assert turns.taken([0, 2], 3.001, 2) == [0]


def test_after_a_jump_of_the_clock_backwards_one_pad_has_its_turn_all_the_same() -> None:
    assert most_at_once(4, -1.0) == 1
