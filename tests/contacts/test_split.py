from __future__ import annotations

from dataclasses import fields, replace
from typing import TYPE_CHECKING

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigged import rigged
from synthetic import assert_same, conditioned, dome, grid_sensor, slips_by
from tabled import hexagonal, table_sensor
from taxelflow.condition.parameters import Conditioner
from taxelflow.messages import Floats, Scans, joined
from taxelflow.pipeline import api
from taxelflow.sensors.sensor import Sensor, with_contacts
from taxelflow.simulation.simulate import simulate

if TYPE_CHECKING:
    from collections.abc import Sequence

    from taxelflow.estimation.base import Mode
    from taxelflow.pipeline.result import Result

GRID = grid_sensor(12, 20)
NOISE = 100.0
Place = tuple[float, float]


def pressed(
    *scans: Sequence[Place | tuple[float, float, float]], sensor: Sensor = GRID, width_m: float = 0.006
) -> Floats:
    """12 idle scans, then domes at places (x, y) in m of each scan, the third number their share of the peak."""
    values = np.zeros((12 + len(scans), sensor.layout.taxels))
    for row, places in zip(values[12:], scans, strict=True):
        domes = [dome(sensor, x, y, radius_m=width_m, peak=50e3 * (share or [1.0])[0]) for x, y, *share in places]
        row[:] = np.sum(domes, axis=0)
    return values + np.random.default_rng(0).normal(0, NOISE, values.shape)


def apart(values: Floats, contacts: int = 2, sensor: Sensor = GRID, **parameters: object) -> Scans:
    """Conditioned scans after the idle ones, with contacts separated."""
    scans, _ = conditioned(values, with_contacts(sensor, contacts), mode="stream", **parameters)
    return Scans(
        *(
            getattr(scans, f.name)[12:] if f.name not in ("noise", "ceiling", "shear") else getattr(scans, f.name)
            for f in fields(scans)
        )
    )


def centres(scans: Scans, contacts: int = 2, sensor: Sensor = GRID) -> Floats:
    """(scans, contacts): where along x each contact's most loaded taxel lies, in cm; NaN where there is none."""
    layout = with_contacts(sensor, contacts).layout
    found = np.full((len(scans), contacts), np.nan)
    for contact in range(contacts):
        own = layout.of_pad(1 + contact)
        top = scans.pressure[:, own].argmax(axis=1)
        found[:, contact] = np.where(scans.contact[:, 1 + contact], 100 * layout.x_m[own][top], np.nan)
    return found


def test_a_contact_in_a_pad_that_reads_as_much_below_0_has_no_centre() -> None:
    small = grid_sensor(4, 4)
    values = np.random.default_rng(0).normal(0.0, NOISE, (22, 16))
    values[17:] = -3.5e3
    values[12:, 0], values[12:, 15] = 30e3, 60e3
    scans = apart(values, sensor=small)
    own = scans.pressure[:, 16:].reshape(10, 2, 16)
    assert scans.contact.all()
    assert (own[5:].sum(axis=2) <= 0.0).sum(axis=1).tolist() == [1] * 5
    assert (scans.complete[:, 1:] == (own.sum(axis=2) > 0.0)).all()


def test_two_blobs_are_two_contacts_and_keep_their_numbers() -> None:
    way = np.linspace(0.0, 0.03, 13)
    scans = apart(pressed(*[[(-0.06 + x, 0.0), (0.06 - x, 0.02, 0.8)] for x in way]))
    assert scans.contact.all()
    np.testing.assert_allclose(centres(scans)[:, 0], 100 * (way - 0.06), atol=0.51)
    np.testing.assert_allclose(centres(scans)[:, 1], 100 * (0.06 - way), atol=0.51)
    layout = with_contacts(GRID, 2).layout
    whole, first, second = (scans.pressure[:, layout.of_pad(pad)] for pad in range(3))
    loaded = whole > 6 * NOISE
    assert ((first > 0) ^ (second > 0))[loaded].all()  # every loaded taxel is one's or the other's
    idle = ~loaded & (first != 0) & (second != 0)
    np.testing.assert_array_equal(first[idle], whole[idle])  # and what nobody has is read by both
    assert idle.sum() > 0.2 * idle.size


def test_a_contact_that_ends_frees_its_number_and_a_new_one_takes_the_lowest() -> None:
    one, two, three = (-0.06, 0.0), (0.0, 0.0, 0.8), (0.06, 0.0, 0.6)
    steps = [[one], [one, two], [one, two, three], [two, three], [two, three], [one, two, three], [three], []]
    scans = apart(pressed(*(step for step in steps for _ in range(6))), contacts=3)
    seen = scans.contact[5::6, 1:].tolist()
    assert seen == [
        [True, False, False],
        [True, True, False],
        [True, True, True],
        [False, True, True],
        [False, True, True],
        [True, True, True],
        [False, False, True],
        [False, False, False],
    ]
    np.testing.assert_allclose(centres(scans, 3)[35], [-6, 0, 6], atol=0.51)


def test_a_number_that_changes_hands_is_without_contact_for_a_scan() -> None:
    scans = apart(pressed(*[[(-0.06, 0.0), (0.02, 0.0)]] * 6, *[[(0.02, 0.0), (0.08, 0.0, 0.8)]] * 6))
    assert np.flatnonzero(~scans.contact.all(axis=1)).tolist() == [6]
    assert np.flatnonzero(~scans.contact[6]).tolist() == [int(np.nanargmin(centres(scans)[5])) + 1]
    assert np.sort(centres(scans)[7]) == pytest.approx([2, 8], abs=0.51)


def test_a_blob_too_many_belongs_to_the_nearest_contact() -> None:
    scans = apart(pressed(*[[(-0.06, 0.0), (0.07, 0.0, 0.8), (0.02, 0.0, 0.5)]] * 6))
    layout = with_contacts(GRID, 2).layout
    near = np.hypot(GRID.layout.x_m - 0.02, GRID.layout.y_m) < 0.012
    assert (scans.pressure[:, layout.of_pad(2)][:, near] > 0).all()
    assert (scans.pressure[:, layout.of_pad(1)][:, near] == 0).all()


def test_contacts_that_meet_are_cut_between_them_and_keep_their_numbers_when_they_part() -> None:
    way = np.concatenate([np.linspace(0.0, 0.035, 15), np.full(10, 0.035), np.linspace(0.035, 0.0, 15)])
    scans = apart(pressed(*[[(-0.05 + x, 0.0), (0.05 - x, 0.0, 0.7)] for x in way]))
    assert scans.contact.all()
    np.testing.assert_allclose(centres(scans)[:, 0], 100 * (way - 0.05), atol=0.51)
    np.testing.assert_allclose(centres(scans)[:, 1], 100 * (0.05 - way), atol=0.51)
    meeting = slice(15, 25)
    assert scans.complete[[0, -1]].all()
    assert scans.complete[meeting, 0].all()
    assert not scans.complete[meeting, 1:].any()  # what one loads beside the other may hide the other's load


def test_a_contact_that_lifts_beside_another_ends() -> None:
    still = [[(-0.02 - x, 0.0), (0.015, 0.0)] for x in np.linspace(0.03, 0.0, 10)]
    lifting = [[(-0.02, 0.0, share), (0.015, 0.0)] for share in np.linspace(1.0, 0.02, 12)]
    scans = apart(pressed(*still, *lifting, *[[(0.015, 0.0)]] * 8))
    assert scans.contact[:18].all()
    assert scans.contact[-1].sum() == 2  # the pad, and the one that stays
    assert np.nanmax(np.abs(centres(scans)[-1] - 1.5)) <= 0.51
    assert scans.complete[-1].all()


def test_pieces_of_an_object_that_lands_are_one_contact() -> None:
    landing = [(-0.03, 0.0), (0.03, 0.0)]
    scans = apart(pressed(landing, *[[(-0.03, 0.0), (0.0, 0.0), (0.03, 0.0)]] * 10))
    assert scans.contact[0].all()
    assert scans.contact[-1].tolist() == [True, True, False]


def test_parts_of_a_contact_become_two_when_they_have_been_apart_for_some_scans() -> None:
    together = [[(-0.008, 0.0), (0.008, 0.0, 0.8)]] * 8
    parting = [[(-0.008 - x, 0.0), (0.008 + x, 0.0, 0.8)] for x in np.linspace(0.0, 0.05, 14)]
    scans = apart(pressed(*together, *parting))
    assert scans.contact[:8].tolist() == [[True, True, False]] * 8
    assert scans.contact[-1].all()
    assert np.flatnonzero(scans.contact[:, 2])[0] > 12
    assert centres(scans)[-1].round() == pytest.approx([-6, 6], abs=1)


def test_a_dead_row_does_not_split_a_contact() -> None:
    row = np.flatnonzero(GRID.layout.row == 6)
    masked = ",".join(map(str, row))
    values = pressed(*[[(0.0, -0.005)]] * 8, width_m=0.015)
    assert apart(values, mask=masked).contact[-1].tolist() == [True, True, False]


@pytest.mark.parametrize("method", ["lnorm", "convolution", "registration", "principal_axis", "sum"])
def test_a_contact_alone_is_what_its_pad_is(method: str) -> None:
    values = pressed(*[[(-0.03 + 0.004 * k, 0.002 * k)] for k in range(10)], [], [], *[[(0.02, 0.0)]] * 4)
    sensor = with_contacts(GRID, 2)
    scans, _ = conditioned(values, sensor, mode="stream")
    slips = slips_by(method, sensor, scans)
    assert slips.contact[:, 1].sum() == 14
    for field in fields(slips):
        values = getattr(slips, field.name)
        if field.name != "t_s":
            np.testing.assert_array_equal(values[:, 1], values[:, 0], err_msg=field.name)
    assert not slips.contact[:, 2].any()


TWO = rigged("two-contacts", motion={"strokes": 1, "travel_m": 0.008}, sensing={"rate_hz": 25.0})
ONE = replace(TWO, second=replace(TWO.second, there=False))


@pytest.fixture(scope="module", params=["batch", "stream"])
def by_itself(request: pytest.FixtureRequest) -> tuple[Mode, Result]:
    """The mode, and what the template makes of an object alone on its pad."""
    return request.param, api.estimate(simulate(ONE), "template", mode=request.param)


@pytest.mark.long
def test_the_template_of_a_contact_alone_is_that_of_its_pad(by_itself: tuple[Mode, Result]) -> None:
    mode, plain = by_itself
    slips = api.estimate(simulate(ONE), "template", mode=mode, contacts="grid=2").slips
    np.testing.assert_array_equal(slips.pose[:, 1], plain.slips.pose[:, 0])
    np.testing.assert_array_equal(slips.covariance[:, 1], plain.slips.covariance[:, 0])
    np.testing.assert_array_equal(slips.quality[:, 0], plain.slips.quality[:, 0])
    assert plain.pads == ("grid",)


@pytest.mark.long
def test_two_contacts_far_apart_have_the_poses_of_each_alone(by_itself: tuple[Mode, Result]) -> None:
    mode, plain = by_itself
    alone = plain.slips
    told = api.estimate(simulate(TWO), "template", mode=mode, contacts=2).slips
    known = np.isfinite(alone.pose[:, 0, 0]) & (np.arange(len(alone)) > 30)
    off = (told.pose[known, 1] - alone.pose[known, 0])[:, :2]
    off -= off.mean(axis=0)  # the pattern's own frame is arbitrary
    std = np.sqrt(np.diagonal(alone.covariance[known, 0], axis1=1, axis2=2)[:, :2])
    assert np.median(np.abs(off) / std) < 0.7
    assert told.contact[:, 2].any()


@pytest.fixture(scope="module")
def meeting() -> tuple[Floats, Scans]:
    """Two contacts that meet, one that stays, another: readings (38, taxels), and their scans as a stream."""
    way = np.linspace(0.0, 0.035, 15)
    values = pressed(
        *[[(-0.05 + x, 0.0), (0.05 - x, 0.0, 0.7)] for x in way], *[[(0.015, 0.0)]] * 5, [], *[[(0, 0)]] * 5
    )
    return values, conditioned(values, with_contacts(GRID, 2), mode="stream")[0]


@pytest.mark.long
@settings(max_examples=20)
@given(cuts=st.lists(st.integers(0, 42), max_size=6))
def test_numbers_do_not_depend_on_how_a_stream_is_cut(meeting: tuple[Floats, Scans], cuts: list[int]) -> None:
    values, whole = meeting
    cut, _ = conditioned(values, with_contacts(GRID, 2), mode="stream", cuts=[c for c in cuts if c <= len(values)])
    assert_same(whole, cut)


def test_a_recording_in_one_block_and_a_stream_give_each_taxel_to_the_same_contact() -> None:
    way = np.linspace(0.0, 0.035, 15)
    values = pressed(*[[(-0.05 + x, 0.0), (0.05 - x, 0.0, 0.7)] for x in way])
    sensor = with_contacts(GRID, 2)
    batch, _ = conditioned(values, sensor, mode="batch", cuts=range(1, 27))
    once, _ = conditioned(values, sensor, mode="batch")
    assert_same(batch, once)
    stream, _ = conditioned(values, sensor, mode="stream")
    np.testing.assert_array_equal(stream.contact, batch.contact)
    clear = np.abs(batch.pressure) > 8 * NOISE  # tare and noise are learned from more scans: faint ones may differ
    np.testing.assert_array_equal(stream.pressure[clear] != 0, True)


def test_contacts_on_a_table_of_taxels() -> None:
    hexagon = table_sensor(hexagonal(9))
    way = np.linspace(0.0, 0.01, 8)
    values = pressed(*[[(-0.03 + x, 0.0), (0.025, x, 0.8)] for x in way], sensor=hexagon, width_m=0.005)
    scans = apart(values, sensor=hexagon)
    assert scans.contact.all()
    np.testing.assert_allclose(centres(scans, sensor=hexagon)[:, 0], 100 * (way - 0.03), atol=0.3)


def test_groups_stay_beside_contacts() -> None:
    from taxelflow.sensors.pads import Group, Patch

    sensor = msgspec.structs.replace(GRID, groups=(Group("left", (Patch("pad0", cols=(0, 9)),)),))
    values = pressed(*[[(-0.05, 0.0), (0.05, 0.0)]] * 6)
    with_both, _ = conditioned(values, with_contacts(sensor, 2), mode="stream")
    plain, _ = conditioned(values, sensor, mode="stream")
    entries = sensor.layout.entries
    np.testing.assert_array_equal(with_both.pressure[:, :entries], plain.pressure)
    np.testing.assert_array_equal(with_both.contact[:, :2], plain.contact)
    layout = with_contacts(sensor, 2).layout
    assert layout.pads == ("pad0", "left", "pad0#1", "pad0#2")
    assert layout.independent.tolist() == [False, True, False, False]


def test_each_contact_has_the_shear_of_its_own_taxels() -> None:
    values = pressed(*[[(-0.06, 0.0), (0.06, 0.02, 0.8)]] * 6)
    shear = np.stack([values, -values], axis=2)
    recording = api.recording(np.arange(len(values)) / 10, values, GRID, shear=shear).with_contacts(2)
    scans = joined(list(api.segmented(recording, Conditioner(tare="none"))))
    assert scans.shear is not None
    layout = recording.layout
    for pad in range(3):
        own = layout.of_pad(pad)
        np.testing.assert_array_equal(scans.shear[12:, own, 0], scans.pressure[12:, own])
