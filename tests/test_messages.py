from __future__ import annotations

from dataclasses import FrozenInstanceError
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from synthetic import assert_same, dome, grid_sensor, pieces, raw_scans, scans_of, slips_by
from taxelflow.contacts.features import ContactFeatures
from taxelflow.fusion.parameters import RigidField
from taxelflow.messages import Event, Output, Slips, cut, joined
from taxelflow.publish.sinks.base import Update
from taxelflow.slip.pattern_change import PatternChanges

PALM = grid_sensor(4, 7)
SCANS = scans_of(PALM, [dome(PALM, x) for x in np.linspace(0, 0.01, 8)], noise=10.0)


@pytest.fixture(scope="module")
def slips() -> Slips:
    return slips_by("convolution", PALM, SCANS)


@pytest.fixture(scope="module")
def messages(slips: Slips) -> dict[str, Any]:
    motions = RigidField().start(PALM.layout).step(slips, np.zeros((*slips.contact.shape, 2)))
    found = [raw_scans(SCANS.pressure), SCANS, slips, motions, Event(0.0, "palm", "contact")]
    return {type(message).__name__: message for message in found}


@pytest.mark.parametrize("name", ["RawScans", "Scans", "Slips", "Motions"])
@given(cuts=st.lists(st.integers(0, 8), max_size=5))
def test_what_is_cut_and_joined_is_whole_again(name: str, cuts: list[int], messages: dict[str, Any]) -> None:
    block = messages[name]
    parts = pieces(block, cuts)
    assert sum(len(part) for part in parts) == len(block) == 8
    assert_same(joined(parts), block)


def test_blocks_within_a_block_are_joined_field_by_field(slips: Slips, messages: dict[str, Any]) -> None:
    """Lists are chained, None stays None, and a field named `noise` is shared by scans only."""
    contacts = ContactFeatures().start(PALM, 6.0, 4.0).step(SCANS).contacts
    rest = messages["Motions"], [messages["Event"]], contacts, *np.zeros((2, *slips.contact.shape))
    outputs = [Output(part, part.contact, *rest) for part in pieces(slips, [3])]
    whole = joined([Update(np.arange(len(output)) + 0.0, output) for output in outputs])
    assert_same(whole.output.slips, slips)
    assert whole.arrived_s.tolist() == [0, 1, 2, 0, 1, 2, 3, 4]
    assert [event.event for event in whole.output.events] == ["contact"] * 2
    assert whole.output.spatial is None
    assert len(whole.output.contacts) == 16
    changes = PatternChanges(*(np.full(shape, 1.0) for shape in (3, 3, *[(3, 2)] * 8, (3, 2, 1, 3))))
    assert joined([changes, changes]).noise.shape == (6, 2)


def test_a_cut_block_looks_into_the_same_memory() -> None:
    assert np.shares_memory(cut(SCANS, 2, 4).pressure, SCANS.pressure)


def test_the_velocity_is_displacement_over_its_time(slips: Slips) -> None:
    np.testing.assert_allclose(slips.velocity[2:, 0, 0], slips.displacement[2:, 0, 0] / 0.1, rtol=1e-12)
    assert np.isnan(slips.velocity[:2]).all()


def test_a_slip_is_valid_where_its_displacement_is_known(slips: Slips) -> None:
    assert slips.valid[:, 0].tolist() == [False] * 2 + [True] * 6


@pytest.mark.parametrize("name", ["RawScans", "Scans", "Slips", "Motions", "Event"])
def test_messages_are_frozen(name: str, messages: dict[str, Any]) -> None:
    with pytest.raises(FrozenInstanceError):
        messages[name].t_s = 0.0
