from __future__ import annotations

import numpy as np

from taxelflow.fusion.spatial.inheritance import inherit
from taxelflow.fusion.spatial.pose import Anchor, Body
from taxelflow.fusion.spatial.robust import Verdict
from taxelflow.fusion.spatial.solve import Contacts, Solution, room, solve
from taxelflow.fusion.spatial.twist import Limits
from taxelflow.numerics.records import Records, records
from taxelflow.runtime.compiling import kernel

PADS, JOINTS, LENGTH_M = 5, 8, 0.05


@kernel
def inherited(
    contacts: Contacts, solution: Solution, limits: Limits, rank: int, anchors: Records, bodies: Records
) -> None:
    inherit(contacts, solution, np.zeros(3), limits, Verdict(rank, 0.0, 0.0, False, 0), anchors, bodies[0])


def test_an_error_that_all_contacts_inherit_is_one_of_the_pose_whatever_the_joints_errors() -> None:
    random = np.random.default_rng(0)
    contacts = Contacts(
        random.normal(size=(PADS, 3, 6)),
        np.zeros((PADS, 3)),
        np.tile(1e8 * np.eye(3), (PADS, 1, 1)),
        0.1 * random.normal(size=(PADS, 3, JOINTS)),
        np.full(JOINTS, 0.005**-2),
        np.ones(PADS),
    )
    solution, anchors, bodies = room(PADS, JOINTS), records(Anchor, PADS), records(Body, 1)
    rank = solve(contacts, 0.1, solution)
    alone = solution.covariance.copy()
    root = 1e-3 * np.tril(random.normal(size=(6, 6)))
    root[0, 0] = 1e-3
    bodies["pose"][:], anchors["root"][:] = np.eye(4), root
    inherited(contacts, solution, Limits(0.02, 0.1, LENGTH_M), rank, anchors, bodies)
    scaled = np.diag([1.0] * 3 + [LENGTH_M] * 3) @ root
    np.testing.assert_allclose(solution.covariance - alone, scaled @ scaled.T, atol=1e-12)
