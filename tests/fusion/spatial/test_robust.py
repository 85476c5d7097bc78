from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chi2, f, norm

from taxelflow.fusion.spatial.robust import excess, misfit, most_chi2, share_of
from taxelflow.fusion.spatial.solve import Contacts, room, solve

LIMIT = 1e6


def contacts_of(seed: int, pads: int, *, spins: bool) -> Contacts:
    random = np.random.default_rng(seed)
    root = random.normal(size=(pads, 3, 3)) + 2.0 * np.eye(3)
    W = root @ np.swapaxes(root, 1, 2)
    if not spins:
        W[:, 2, :] = W[:, :, 2] = 0.0
    return Contacts(
        random.normal(size=(pads, 3, 6)),
        random.normal(size=(pads, 3)),
        W,
        np.zeros((pads, 3, 0)),
        np.zeros(0),
        np.ones(pads),
    )


@given(st.integers(0, 10_000), st.integers(5, 8), st.booleans())
def test_the_share_of_a_contact_is_what_chi_square_falls_by_without_it(seed: int, pads: int, spins: bool) -> None:
    contacts, solution = contacts_of(seed, pads, spins=spins), room(pads, 0)
    parts = 3 if spins else 2
    whole, _ = misfit(contacts, solve(contacts, LIMIT, solution), solution)
    share = share_of(contacts, 1, parts, solution, np.empty((3, 6)), np.empty((3, 3)), np.empty(3))
    contacts.use[1] = 0.0
    without, _ = misfit(contacts, solve(contacts, LIMIT, solution), solution)
    assert share == pytest.approx(whole - without, rel=1e-6, abs=1e-9 * whole)


@pytest.mark.parametrize("freedom", [3, 6, 12, 30])
def test_quantiles_are_those_of_chi_square_and_f(freedom: int) -> None:
    assert most_chi2(float(freedom)) == pytest.approx(chi2.ppf(0.999, freedom), rel=0.02)
    beyond = norm.sf(excess(float(f.ppf(0.999, 3, freedom)), float(freedom)))
    assert 0.65e-3 < beyond < (1.35e-3 if freedom > 6 else 4e-3)  # with little freedom fewer contacts are judged
