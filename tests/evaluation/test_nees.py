from __future__ import annotations

import numpy as np
import pytest

from taxelflow.evaluation.nees import consistency, nees_of
from taxelflow.messages import Floats

COVARIANCE = np.array([[4.0, 1.0, 0.2], [1.0, 2.0, -0.3], [0.2, -0.3, 0.5]]) * 1e-8


def drawn(contacts: int, scans: int, scale: float = 1.0, seed: int = 0) -> list[tuple[Floats, Floats]]:
    random = np.random.default_rng(seed)
    error = random.multivariate_normal(np.zeros(3), COVARIANCE, (contacts, scans), method="cholesky")
    return [(scale * own, np.tile(COVARIANCE, (scans, 1, 1))) for own in error]


@pytest.mark.long
@pytest.mark.parametrize("over", [1, 20, 100])
def test_an_honest_covariance_lies_in_its_band_19_times_in_20(over: int) -> None:
    runs = [consistency(drawn(4, 250, seed=seed), over) for seed in range(200)]
    inside = [run.low <= run.nees <= run.high for run in runs if run.nees and run.low and run.high]
    assert len(inside) == 200
    assert 0.88 < np.mean(inside) <= 0.99
    assert np.mean([run.nees for run in runs if run.nees]) == pytest.approx(1, abs=0.02)


def test_errors_twice_as_large_as_claimed_give_4_outside_the_band() -> None:
    found = consistency(drawn(5, 200, scale=2.0), 1)
    assert found.nees == pytest.approx(4, rel=0.15)
    assert found.high is not None
    assert found.high < 1.2


def test_no_scan_is_in_two_pairs_and_all_reach_over_as_many_scans() -> None:
    error = np.zeros((23, 3))
    error[:, 0] = 10.0 ** np.arange(-23, 0)
    nees, _ = nees_of(error, np.tile(np.eye(3), (23, 1, 1)), 4)
    # pairs (0, 4) to (3, 7), (8, 12) to (11, 15), (16, 20) to (18, 22)
    later = [4, 5, 6, 7, 12, 13, 14, 15, 20, 21, 22]
    expected = [(error[k, 0] - error[k - 4, 0]) ** 2 / 2 for k in later]
    np.testing.assert_allclose(nees, expected, rtol=1e-9)


def test_neighbours_that_err_alike_count_for_less() -> None:
    apart = drawn(4, 400)
    smooth = [(np.cumsum(error, axis=0), 30 * covariance) for error, covariance in apart]
    assert consistency(apart, 20).independent > 0.6 * consistency(apart, 20).pairs
    alike = consistency(smooth, 20)
    assert 4 <= alike.independent < 0.3 * alike.pairs
    assert alike.low is not None
    assert consistency(apart, 20).low is not None
    assert alike.low < (consistency(apart, 20).low or 0)


def test_an_axis_without_a_number_is_left_out() -> None:
    contacts = drawn(2, 100)
    for error, covariance in contacts:
        error[:, 2] = covariance[:, 2] = covariance[:, :, 2] = np.nan
    nees, freedom = nees_of(*contacts[0], 1)
    assert set(freedom) == {2.0}
    assert np.isfinite(nees).all()
    assert consistency(contacts, 1).nees == pytest.approx(1, abs=0.25)


def test_unknown_scans_are_in_no_pair() -> None:
    (error, covariance), _ = drawn(2, 10)
    error[4] = np.nan
    nees, _ = nees_of(error, covariance, 1)
    assert len(nees) == 4


def test_a_covariance_that_claims_to_know_all_is_infinitely_wrong() -> None:
    error = np.full((4, 3), 1e-6) * np.arange(4)[:, np.newaxis]
    for certain in (np.zeros((3, 3)), np.ones((3, 3))):
        found = consistency([(error, np.tile(certain, (4, 1, 1)))], 1)
        assert found.nees == np.inf


def test_a_contact_that_is_too_short_has_none() -> None:
    found = consistency(drawn(3, 20), 20)
    assert (found.nees, found.low, found.high, found.pairs) == (None, None, None, 0)
