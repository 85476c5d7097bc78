"""What a stream divides readings by, and when a taxel called dead is alive again."""

from __future__ import annotations

import numpy as np
import pytest

from synthetic import grid_sensor
from taxelflow.estimation.template.observations import Scanned
from taxelflow.estimation.template.online.hand import Scan
from taxelflow.estimation.template.online.hand_gains import HandGains
from taxelflow.messages import Floats

PAD = grid_sensor(3, 3, pitch_m=(0.004, 0.004))
DEAD = 4
LOUDEST = 10e3
NOISE = 50.0


def scan(reading: Floats) -> Scan:
    return Scan(0.0, reading, np.full(9, NOISE**2), np.full(9, np.inf), reading, np.array([True]))


def with_a_dead_taxel() -> HandGains:
    gains = np.full(9, 0.9)
    gains[DEAD] = np.inf
    own = HandGains(PAD.layout)
    own.put(0, gains)
    return own


def loaded(dead: float) -> Scan:
    reading = np.full(9, LOUDEST)
    reading[DEAD] = dead
    return scan(reading)


def test_without_gains_a_scan_stays_what_it_is() -> None:
    given = loaded(0.0)
    assert HandGains(PAD.layout).divided(given) is given


@pytest.mark.parametrize("dead", [0.0, 0.09 * LOUDEST])
def test_a_dead_taxel_is_masked_and_the_others_are_divided(dead: float) -> None:
    found = with_a_dead_taxel().divided(loaded(dead))
    assert found.variance[DEAD] == 0.0
    np.testing.assert_allclose(np.delete(found.reading, DEAD), LOUDEST / 0.9)
    np.testing.assert_array_equal(found.raw, loaded(dead).raw)


def test_a_taxel_called_dead_is_alive_once_it_reads_under_load() -> None:
    own = with_a_dead_taxel()
    assert own.divided(loaded(0.11 * LOUDEST)).variance[DEAD] == NOISE**2
    assert own.divided(loaded(0.0)).variance[DEAD] == NOISE**2


def test_noise_where_nothing_touches_makes_no_taxel_alive() -> None:
    own, faint = with_a_dead_taxel(), np.zeros(9)
    faint[DEAD] = 5.0 * NOISE
    assert own.divided(scan(faint)).variance[DEAD] == 0.0


@pytest.mark.parametrize(("read", "works"), [(0.5 * LOUDEST, True), (0.05 * LOUDEST, False)])
def test_what_a_contact_has_shown_to_work_is_known_to_the_next(read: float, works: bool) -> None:
    own, readings = HandGains(PAD.layout), np.tile(loaded(read).reading, (4, 1))
    nothing = np.zeros(9)
    scanned = Scanned.of(np.arange(4.0), np.zeros((2, 9)), readings, np.full((4, 9), NOISE**2), nothing, nothing)
    own.ended(0, scanned)
    assert own.alive.tolist() == [taxel != DEAD or works for taxel in range(9)]
