"""Blocks of scans that NumPy works on come out as from the kernels, to the bit."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from taxelflow.estimation.centroid.records import Row
from taxelflow.estimation.centroid.session import unpack, unpack_block
from taxelflow.fusion.hand_frame import Carrier, Home
from taxelflow.fusion.reference import place_block, place_points
from taxelflow.messages import Slips, Texture, cut
from taxelflow.numerics.geometry import rotation
from taxelflow.numerics.records import records, unknown
from taxelflow.pipeline.warmup import made_up
from taxelflow.runtime.blocks import is_block
from taxelflow.sensors.border import border_of, mark_border, mark_border_block
from taxelflow.slip.decision import Flags, decide, decide_block
from taxelflow.slip.detector import has_flips
from taxelflow.slip.measurement import observations
from taxelflow.slip.session import has_flips_in_block
from taxelflow.slip.slip_rows import MOST_ROWS, Progress, hold_block, hold_scans
from taxelflow.slip.slip_rows import Row as SlipRow

PADS = 4
SEEDS = pytest.mark.parametrize("seed", range(8))


def equal(one: Any, other: Any) -> bool:
    """Records or arrays, a NaN as good as another."""
    if one.dtype.names:
        return all(equal(one[name], other[name]) for name in one.dtype.names)
    return np.array_equal(one, other, equal_nan=one.dtype.kind == "f")


def random_slips(rng: np.random.Generator, scans: int) -> Slips:
    shape = (scans, PADS)

    def some(*size: int) -> Any:
        values = rng.normal(size=(*shape, *size))
        values[rng.random(shape) < 0.2] = np.nan
        return values

    flags = np.cumsum(rng.random(shape) < 0.1, axis=0) % 2 == 1
    return Slips(
        np.arange(scans) * 0.01,
        flags,
        rng.random((*shape, 2)) < 0.4,
        some(3),
        some(3),
        some(3, 3),
        some(3, 3),
        *(some() for _ in range(4)),
        rng.integers(0, 4, shape).astype(np.uint8),
    )


def scan_by_scan(slips: Slips) -> list[Slips]:
    return [cut(slips, k, k + 1) for k in range(len(slips))]


@SEEDS
def test_observations_and_flips(seed: int) -> None:
    rng = np.random.default_rng(seed)
    slips = random_slips(rng, 30)
    assert equal(observations(slips), np.concatenate([observations(one) for one in scan_by_scan(slips)]))
    last = slips.contact[:1]
    for flags in (slips.contact[:0], slips.contact[:1], slips.contact[:3], ~slips.contact[:1], slips.contact):
        assert has_flips(last, flags) == has_flips_in_block(last, flags)


@SEEDS
def test_estimates_are_unpacked(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rows = unknown(Row, 20, PADS)
    rows.view(np.float64)[...] = rng.normal(size=rows.view(np.float64).shape)
    found = []
    for function in (unpack, unpack_block):
        filled = [np.zeros(shape) for shape in ((2, 20, PADS, 3), (2, 20, PADS, 3, 3), (3, 20, PADS))]
        function(rows, *filled)
        found.append(filled)
    assert all(equal(one, other) for one, other in zip(*found, strict=True))


@SEEDS
def test_borders_are_marked(seed: int) -> None:
    rng = np.random.default_rng(seed)
    layout = made_up(split=True).layout
    noise = np.where(rng.random(layout.entries) < 0.1, 0.0, 1.0)
    pressure = rng.exponential(3.0, (25, layout.entries))
    pressure[rng.random(pressure.shape) < 0.05] = np.nan
    contact = rng.random((25, len(layout.pads))) < 0.7
    marks = [np.zeros((*contact.shape, 2), dtype=np.bool_) for _ in range(2)]
    for function, mark in zip((mark_border, mark_border_block), marks, strict=True):
        function(pressure, noise, contact, *border_of(layout), mark)
    assert marks[0].any() and not marks[0].all()
    assert equal(*marks)


@SEEDS
def test_points_are_placed(seed: int) -> None:
    rng = np.random.default_rng(seed)
    slips = random_slips(rng, 60)
    centroid = rng.normal(size=(60, PADS, 2))
    centroid[rng.random((60, PADS)) < 0.3] = np.nan
    turns = rng.random((60, PADS)) < 0.5
    offsets, points = [np.full((PADS, 2), np.nan) for _ in range(2)], []
    for function, offset in zip((place_points, place_block), offsets, strict=True):
        point = np.zeros((60, PADS, 2))
        for begin, end in ((0, 10), (10, 10), (10, 11), (11, 60)):
            own = slice(begin, end)
            function(slips.pose[own], True, (turns[own], slips.contact[own]), centroid[own], offset, point[own])
        points.append(point)
    assert equal(*points) and equal(*offsets)


@SEEDS
@pytest.mark.parametrize("textured", [True, False])
def test_slips_are_carried(seed: int, textured: bool) -> None:
    rng = np.random.default_rng(seed)
    slips = random_slips(rng, 30)
    turns, unobservable = rng.random((30, PADS)) < 0.7, rng.random((30, PADS, 2, 2))
    texture = Texture(slips.t_s, slips.contact, turns, unobservable) if textured else None
    place, pitch = rng.normal(size=(PADS, 2)), rng.random((PADS, 2))
    home = Home(rotation(rng.uniform(-3, 3, PADS)), place, pitch, np.arange(PADS) != 2, 0.3)
    point = rng.normal(size=(30, PADS, 2))
    formed = rng.random(slips.contact.shape) < 0.7
    carried, *spread = Carrier(home).step(slips, point, formed, texture)
    for k, one in enumerate(scan_by_scan(slips)):
        own_texture = cut(texture, k, k + 1) if texture is not None else None
        own, *own_spread = Carrier(home).step(one, point[k : k + 1], formed[k : k + 1], own_texture)
        for whole, part in zip([*carried, *spread], [*own, *own_spread], strict=True):
            assert equal(whole[k : k + 1], part)


@SEEDS
def test_verdicts_are_reached(seed: int) -> None:
    rng = np.random.default_rng(seed)
    flags = Flags(*(rng.random((40, PADS)) < share for share in (0.5, 0.2, 0.2, 0.9, 0.3, 0.6, 0.5)))
    odds = rng.normal(-2.0, 3.0, (2, 40, PADS))
    odds[1, rng.random((40, PADS)) < 0.1] = np.nan
    since_s = np.where(rng.random((40, PADS)) < 0.2, np.inf, -np.inf)
    whole = np.array([-1, -1, 0, 1])  # groups come after their pads
    last = [rng.random((1, PADS)) < 0.5 for _ in range(2)]
    found = []
    for function in (decide, decide_block):
        final, by_odds = (np.zeros((40, PADS), dtype=np.bool_) for _ in range(2))
        changes = function(flags, whole, (odds[0], odds[1]), since_s, *last, final, by_odds)
        found.append((final, by_odds, np.array(changes)))
    assert all(equal(one, other) for one, other in zip(*found, strict=True))


@SEEDS
def test_rows_of_slips_are_held(seed: int) -> None:
    rng = np.random.default_rng(seed)
    scans = MOST_ROWS + 90  # so that rows are averaged once
    slips = random_slips(rng, scans)
    slipping = rng.random((scans, PADS)) < 0.5
    found = []
    for function in (hold_scans, hold_block):
        progress, room = records(Progress, PADS), records(SlipRow, PADS, MOST_ROWS)
        for begin, end in ((0, 40), (40, 41), (41, 300), (300, scans)):
            seen = (slips.pose, slips.covariance, slips.displacement, slips.displacement_covariance)
            marks = (slipping, slips.quality)
            function((slips.t_s, slips.lag_s), seen, marks, np.array([0, 2]), (begin, end), progress, room)
        found.append((progress, room))
    assert all(equal(one, other) for one, other in zip(*found, strict=True))


def test_numpy_works_on_few_scans_only_while_the_kernel_is_not_compiled() -> None:
    ready, fresh = SimpleNamespace(overloads={"types": "code"}), SimpleNamespace(overloads={})
    scans = (0, 1, 2, 16, 10_000)
    assert [is_block(count, fresh) for count in scans] == [True, False, True, True, True]  # type: ignore[arg-type]
    assert [is_block(count, ready) for count in scans] == [True, False, False, False, True]  # type: ignore[arg-type]
