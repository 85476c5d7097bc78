from __future__ import annotations

import numpy as np

from synthetic import grid_sensor, scans_of, unknown_slips
from taxelflow.fusion.reference import Reference
from taxelflow.messages import Slips, cut

CENTROID = np.array([[[0.004, 0.001]]] * 6)


def contact(theta: float = np.nan) -> Slips:
    """A pose 6 mm beside the contact's centroid, which moves by 1 mm a scan."""
    slips = unknown_slips(scans_of(grid_sensor(4, 4), np.zeros((6, 16))))
    slips.pose[..., 0] = -0.002 + 0.001 * np.arange(6)[:, np.newaxis]
    slips.pose[..., 1] = 0.001
    slips.pose[..., 2] = theta
    return slips


def test_a_pose_with_a_turn_is_that_of_its_own_point() -> None:
    slips = contact(theta=0.1)
    np.testing.assert_array_equal(Reference(1).step(slips, CENTROID), slips.pose[..., :2])


def test_a_pose_without_a_turn_moves_the_centroid_where_the_contact_began() -> None:
    slips = contact()
    found = Reference(1).step(slips, CENTROID)
    np.testing.assert_allclose(found[:, 0, 0], 0.004 + 0.001 * np.arange(6))


def test_it_starts_again_with_a_new_contact_and_does_not_depend_on_blocks() -> None:
    slips = contact()
    slips.contact[2] = False
    slips.pose[2] = np.nan
    whole = Reference(1).step(slips, CENTROID)
    np.testing.assert_allclose(whole[3:, 0, 0], 0.004 + 0.001 * np.arange(3))
    session = Reference(1)
    parts = [session.step(cut(slips, k, k + 1), CENTROID[k : k + 1]) for k in range(6)]
    np.testing.assert_array_equal(np.concatenate(parts), whole)
