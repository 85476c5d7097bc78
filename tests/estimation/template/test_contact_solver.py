"""What a contact's fit is after its dead taxels and gains."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taxelflow.estimation.template import contact_solver
from taxelflow.estimation.template.contact_solver import solve_contact
from taxelflow.estimation.template.observations import Scanned

if TYPE_CHECKING:
    import pytest

    from taxelflow.estimation.template.solution import Solved


def sliding() -> Scanned:
    """A dome that slides by 3 pitches over 7 x 5 taxels."""
    places = np.stack([axis.ravel() for axis in np.meshgrid(np.arange(7.0), np.arange(5.0))])
    apart = np.hypot(places[0] - np.linspace(1.5, 4.5, 40)[:, np.newaxis], places[1] - 2.0)
    readings = np.maximum(1.0 - (apart / 2.2) ** 2, 0.0)
    each = np.full(readings.shape, 1e-6), np.full(35, np.inf), np.zeros(35)
    return Scanned.of(0.02 * np.arange(40), places, readings, *each)


def test_scans_that_gains_move_far_are_not_known(monkeypatch: pytest.MonkeyPatch) -> None:
    def moved(_scanned: Scanned, solved: Solved) -> Solved:
        gained = solved.copy()
        gained.states[30:, 0] += 0.3  # pitches, as another minimum does
        return gained

    before = solve_contact(sliding())
    monkeypatch.setattr(contact_solver, "with_gains", moved)
    agrees = solve_contact(sliding()).agrees
    assert not agrees[30:].any()
    np.testing.assert_array_equal(agrees[:30], before.agrees[:30])
    assert before.agrees.all()
